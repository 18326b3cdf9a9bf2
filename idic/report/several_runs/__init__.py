"""Pages of several runs: a batch, a comparison, experiments identified together."""
