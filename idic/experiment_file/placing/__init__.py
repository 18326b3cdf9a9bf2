"""Place of the mesh before calibrated cameras from what their reference images show: holes, edges, the surface."""
