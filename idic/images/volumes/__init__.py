"""Volumes: the scanner that sees them, and their filters block by block."""
