"""What the stages of measured fields show beside the log."""
