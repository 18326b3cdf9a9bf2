"""Pages and figures of studies and of the gallery."""
