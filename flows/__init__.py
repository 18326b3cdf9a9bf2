"""The orchestration layer: Prefect flows over plain idic functions. Importing this package starts nothing."""
