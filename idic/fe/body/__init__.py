"""The record of a body: sections, constraints and loads, boundary conditions, a stress that varies over it."""
