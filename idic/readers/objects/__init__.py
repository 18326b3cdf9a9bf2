"""Readers of Python objects: arrays as images, meshes of programs, tables as logs."""
