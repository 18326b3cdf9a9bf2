"""The page of planned tests: figures, words."""
