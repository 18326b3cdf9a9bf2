"""Files of instruments by the libraries of `pip install idic[instruments]`."""
