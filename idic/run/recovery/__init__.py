"""Resuming a RUN: what is stored is read once, by the workers where it is much; what is damaged is computed anew."""
