"""Assessment of a finished run: the camera floor, the free FE-DIC, local tests, and remedies tried by
themselves."""
