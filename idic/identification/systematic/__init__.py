"""Systematic errors of an identification: discretisation bias and the spread over treatments of boundary and camera."""
