"""Images: stacks of frames, B-spline interpolation, cameras, low-pass; `quality/`: noise and speckle."""
