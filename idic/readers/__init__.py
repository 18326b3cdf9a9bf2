"""Readers of files: images, videos, meshes and logs as arrays with units; sets by position."""
