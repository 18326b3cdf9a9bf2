"""Exports of single systems that are more than a table or none, and columns that a user names."""
