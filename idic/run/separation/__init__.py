"""Planned tests ranked by how well they tell the candidates of a diagnosed RUN apart."""
