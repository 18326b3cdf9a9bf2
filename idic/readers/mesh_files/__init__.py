"""Mesh files that idic reads itself: decks of Abaqus, CalculiX and Nastran, msh of gmsh, MED of Salome."""
