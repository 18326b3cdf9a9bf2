"""The tables of experiment.toml, each from its schema to records in internal units."""
