"""All formats that idic reads, in one table."""
