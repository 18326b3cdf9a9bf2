"""What a finished run is judged by: the camera's floor, the free FE-DIC, local tests, and remedies tried by
themselves."""
