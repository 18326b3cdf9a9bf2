"""The moves of a diagnosis, a file per subject, and the tables that order them."""
