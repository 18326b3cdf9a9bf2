"""The formats that idic reads: what each reader declares of its own, in one table."""
