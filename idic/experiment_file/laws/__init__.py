"""Laws of experiment.toml that are tables of terms or free curves, as flat parameters."""
