"""The images of a test one after the other: their order, repeated and lost ones, late cameras."""
