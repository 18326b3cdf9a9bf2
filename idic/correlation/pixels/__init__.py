"""Pixels and elements: position of each pixel in its element, sums of shape functions over pixels, nodal fields."""
