"""One stage, whatever system wrote it: its text, which points are measured, and of which state its positions are."""
