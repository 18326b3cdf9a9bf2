"""Fields for the eye and for tables: strain, stress and state on the surface, simulated and measured, and their
noise."""
