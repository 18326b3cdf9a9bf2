"""Files to arrays with units: images, videos, meshes, logs, sets by position."""
