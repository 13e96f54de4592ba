"""Simulations: the Python interface, tasks, the run as a generator, many tests at once, a finite element's grains."""
