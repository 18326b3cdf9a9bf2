"""Virtual tomograms: where the material of every voxel comes from, and what a reconstruction adds to it."""
