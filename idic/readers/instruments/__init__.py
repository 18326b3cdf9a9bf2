"""Files of instruments by the libraries of `pip install idic[instruments]`: profilometers, high-speed cameras, machines."""
