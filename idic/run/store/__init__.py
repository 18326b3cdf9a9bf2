"""The RUN folder on disk: Zarr arrays with checksums, the checkpoint, the lock, result.json."""
