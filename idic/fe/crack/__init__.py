"""Cracks of a sheet: the mesh cut along a path, faces that open behind a tip, stress intensity factors and J."""
