"""Several specimens of one material: what each says of the shared parameters, and how far specimens differ.

`own_values` steps from the joint values to those of each specimen; `scatter` is the standard deviation between them.
"""
