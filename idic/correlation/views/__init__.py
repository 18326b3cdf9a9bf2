"""From motion in space to motion in the image of a camera or profilometer."""
