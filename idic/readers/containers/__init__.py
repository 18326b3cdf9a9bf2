"""Files that may point to other files: what they point to is looked at before a library follows it."""
