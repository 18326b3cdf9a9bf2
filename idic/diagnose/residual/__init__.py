"""The residual of a finished identification: whitened, at the nodes, with its excess over noise."""
