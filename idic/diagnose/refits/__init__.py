"""A candidate as a separate model, refitted; the refit as a task that a process can run."""
