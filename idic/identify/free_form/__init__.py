"""Free curves of a law: what the data say of the number of their knots."""
