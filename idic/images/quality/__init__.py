"""Quality of an image: camera noise, error of the interpolating spline, size of the speckle."""
