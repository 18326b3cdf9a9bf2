"""Pixels and elements: which pixel lies where, sums of shape functions over pixels, fields of a camera at the nodes."""
