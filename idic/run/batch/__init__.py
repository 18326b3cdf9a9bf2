"""`idic batch`: many identifications, one summary."""
