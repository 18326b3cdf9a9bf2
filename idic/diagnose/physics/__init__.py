"""What every candidate physics declares, and the edits of experiment.toml that candidates share."""
