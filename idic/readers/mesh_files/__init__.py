"""Mesh files that idic reads itself: input decks of Abaqus, CalculiX and Nastran, and msh of gmsh."""
