"""From one frame to its equations: image kernel, sums at the nodes, M and b as records that add.

Grey images are the kind that is compared here; `comparison` is the protocol of all kinds.
"""
