"""The experiment that a plan describes: [design] replaces images and logs that do not exist yet."""
