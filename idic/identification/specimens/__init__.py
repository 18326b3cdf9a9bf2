"""Several specimens of one material: estimates of the shared parameters from each, and the scatter between them.

`own_values` steps from the joint values to those of each specimen; `scatter` is the standard deviation between them.
"""
