"""experiment.toml as strict models, one file for each group of its tables."""
