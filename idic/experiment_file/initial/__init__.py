"""What `idic init` finds in a folder, and its report of it."""
