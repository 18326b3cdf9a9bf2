"""Reads experiment.toml into an `Experiment`: schema, checks, messages."""
