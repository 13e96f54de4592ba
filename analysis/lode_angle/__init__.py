"""The critical state as a function of the Lode angle, from the same cubes."""
