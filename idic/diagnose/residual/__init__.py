"""The residual of a finished identification: at the nodes and in channels, its excess over noise, its score tests."""
