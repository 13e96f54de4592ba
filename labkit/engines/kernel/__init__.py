"""The kernel of the fused engine: the functions of a time step in Python, and the way to the host that calls them.

A time step, read from above: `labkit/engines/host/loop.hpp` is the loop, `blocks.py` lists the functions that it calls,
and these are written in `contact_block.py` (around `pair` of the contact law), `motion.py` and `bodies.py`, and for the
servo in `labkit/servo/formula.py`.

layout.py         memory layout of contacts and grains, which host/layout.hpp repeats
blocks.py         the functions that the host calls, for the features of a scene
contact_block.py  contact forces of a block, with the contact law
motion.py         motion of grains and cell, and when a neighbour search is due
bodies.py         motion of clumps
translate.py      prepares plain Python functions for Numba, in double or single precision
sources.py        stamps of the sources of a law, which is tried out first if it is a user's
scalars.py        scalar versions of numpy's functions
machine.py        machine code of functions, kept in files
ship.py           machine code of labkit's laws for the wheel
ahead.py          compiles some of them in a second process
tables.py         NamedTuples of arrays as tables of pointers
host.py           the C++ library for NumPy arrays; checks them
loop.py           the loop over time steps of that library
neighbours.py     which grains may touch: spatial order, pairs, periodic shifts, images
packing.py        converts grains and contacts to blocks, sites and domains, and back
memory.py         memory aligned to cache lines
"""
