"""`idic calibrate`: from image files to a calibration file and a picture."""
