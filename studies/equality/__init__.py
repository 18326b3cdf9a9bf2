"""Equality of two versions of idic: the same cases give the same bits, words and number of computations."""
