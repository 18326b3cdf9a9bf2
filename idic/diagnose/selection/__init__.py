"""Which causes join the model: rivals refitted, judged on held-out data, tested for removal and exchange."""
