"""Validation of idic: studies with known truth, the blind trial of the diagnosis, and their pages.

Nothing of the product imports it; only the commands and the flows do.
"""
