"""Fields for viewer and tables: strain, stress and state variables on the surface, simulated and measured, and their
noise."""
