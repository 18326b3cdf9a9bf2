"""experiment.toml to an `Experiment`: schema, checks, messages."""
