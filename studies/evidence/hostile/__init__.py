"""Campaigns of hostile and damaged input against idic in one process: ``python -m idic_studies.evidence.hostile``."""
