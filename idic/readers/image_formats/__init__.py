"""What formats of images say of their frames: the axes of stacks, and grey values behind a palette."""
