"""Bodies of several grains; their motion is in engines/kernel/bodies.py, their statistics are in micro/bodies.py.

kinds   how a kind of body declares its variables, and how bodies are read from files
clumps  rigid clumps of spheres: variables, geometry, motion, energy and stability
shapes  shapes of clumps, and the replacement of single spheres by clumps
"""
