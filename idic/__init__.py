"""Time-resolved Integrated Digital Image Correlation: images and force in, constitutive parameters out."""

__version__ = "0.1.0"
