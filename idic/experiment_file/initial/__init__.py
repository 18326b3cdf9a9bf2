"""What `idic init` finds in a folder, and what it tells of it."""
