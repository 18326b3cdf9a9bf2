"""Rate-dependent laws: creep, viscoelasticity, glassy polymers."""
