"""Laws with time in them: creep, viscoelasticity, glassy polymers."""
