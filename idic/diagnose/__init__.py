"""When simulation and recording differ: where, when, which physics, and the proof that modelling it helps."""
