"""What happens in a virtual test of the blind trial: scenes, effects, two solvers, the recording."""
