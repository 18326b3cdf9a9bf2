"""External finite-element programs as black boxes: input deck, process, output."""
