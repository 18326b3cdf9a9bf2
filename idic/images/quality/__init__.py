"""What an image is worth: camera noise, low-pass, error of the interpolating spline, size of the speckle."""
