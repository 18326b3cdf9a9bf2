"""Score tests of the candidate physics, and the shortlist that is refitted."""
