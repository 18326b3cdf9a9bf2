"""The studies and the blind trial as Prefect flows."""
