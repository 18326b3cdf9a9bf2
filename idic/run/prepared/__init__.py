"""A prepared RUN: how it is prepared, the experiment as a worker sees it, its tasks, what they have cost."""
