"""Execution of tasks: in this process or on Dask workers; the Prefect server of a run."""
