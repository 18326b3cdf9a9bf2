"""Where tasks run: in this process, on Dask workers; and the Prefect server of a run."""
