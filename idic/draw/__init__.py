"""`idic draw`: a local page that draws the mesh on the reference image, writes experiment.toml and starts `idic
identify`."""
