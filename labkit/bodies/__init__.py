"""Bodies of several grains: all of them but their motion (engines/kernel/bodies.py) and statistics (micro/bodies.py).

kinds   how a kind of bodies declares its variables, and how files give them back
clumps  rigid clumps of spheres: variables, geometry, motion, energy and stability
shapes  shapes of clumps, and clumps in place of single spheres
"""
