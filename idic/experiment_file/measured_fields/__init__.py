"""[experiment] fields: the displacements that another DIC system exported, in the place of images."""
