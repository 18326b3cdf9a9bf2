"""The experiment that a plan describes: missing images and logs take the plan's place."""
