"""Causes of a misfit that the measured motion shows, each with its signature, and the lines that mend it."""
