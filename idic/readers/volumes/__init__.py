"""Scans of volumes, of which blocks are read: TIFF stacks, slices, raw files with a header, Zarr, HDF5, NPY."""
