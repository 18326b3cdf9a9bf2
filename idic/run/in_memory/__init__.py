"""Identifications without the files of a RUN."""
