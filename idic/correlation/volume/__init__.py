"""Volumes: their voxels in the elements of a solid, the volume kernel, the equations of a scan at the nodes."""
