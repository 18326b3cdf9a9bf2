"""The mesh on what was measured, drawn before the first simulation."""
