"""Simulations: Python interface, tasks, the run as a generator, many tests at once, grains in a finite element."""
