"""Studies of the method on virtual tests: cases, what they keep, and the figures drawn from them."""
