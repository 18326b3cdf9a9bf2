"""Laws with plastic flow: isotropic, kinematic, anisotropic and pressure-dependent, with or without rate."""
