"""The page of a diagnosis: record, figures, words."""
