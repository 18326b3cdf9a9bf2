"""Frames by the names and the headers of their files: their order."""
