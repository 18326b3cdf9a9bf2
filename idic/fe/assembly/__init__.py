"""From nodal displacements to nodal forces and stiffness: element kernels, locking remedies, assembly."""
