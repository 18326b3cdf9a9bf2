"""`idic design`: planned tests from experiment.toml to their page."""
