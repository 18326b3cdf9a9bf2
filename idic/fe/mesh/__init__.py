"""Meshes: nodes, cells and sets, shape functions, refinement, coarsening, morphing."""
