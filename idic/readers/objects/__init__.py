"""Python objects as what the readers make of files: arrays as images, meshes of programs, tables as logs."""
