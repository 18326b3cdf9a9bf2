"""Resuming a RUN: stored parts are verified once, large ones by the workers; damaged parts are computed again."""
