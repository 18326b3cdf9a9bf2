"""Conversion of the tables of experiment.toml into records in internal units."""
