"""What idic is measured by; not part of the product and not installed with it (`pip install ./studies`)."""
