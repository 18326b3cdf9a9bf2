"""Quality of an image: camera noise, low-pass, error of the interpolating spline, size of the speckle."""
