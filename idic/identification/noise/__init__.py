"""Correlated noise of channels, estimated from the channel residuals of an identification."""
