"""Bodies of several grains: all that labkit knows of them, apart from the compiled motion in engines/kernel/bodies.py.

declared    how a kind of bodies declares its variables
clumps      rigid clumps of spheres: variables, geometry, motion, energy and stability
shapes      shapes of clumps, and clumps in place of single spheres
files       bodies in state and run files
statistics  the Snapshot of bodies, and their own statistics
"""
