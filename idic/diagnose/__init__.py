"""Diagnosis of model error: place, onset and missing physics of a misfit, judged by refits on held-out data."""
