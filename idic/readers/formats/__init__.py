"""What each reader declares of its formats."""
