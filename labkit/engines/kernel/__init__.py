"""The kernel of the fused engine: the functions of a time step in Python, and the way to the host that calls them.

To follow a time step, start at the loop in `labkit/engines/host/loop.hpp`; `blocks.py` lists the functions that the
loop calls. These functions are in `contact_block.py` (around `pair` of the contact law), `motion.py`, `bodies.py` and,
for the servo, `labkit/servo/formula.py`.

layout.py         memory layout of contacts and grains; host/layout.hpp has the same numbers
blocks.py         the functions that the host calls, for the features of a scene
contact_block.py  contact forces of a block, with the contact law
motion.py         motion of grains and cell, and when a neighbour search is due
bodies.py         motion of clumps
translate.py      prepares plain Python functions for Numba, in double or single precision
sources.py        stamps of the sources of a contact law; a first try of user-defined laws
scalars.py        scalar versions of numpy's functions
machine.py        machine code of functions, stored in files
ship.py           machine code of labkit's laws for the wheel
ahead.py          compiles the functions that all laws share in a second process
tables.py         NamedTuples of arrays as tables of pointers
host.py           calls the C++ library with NumPy arrays and checks them
loop.py           the loop over time steps in the C++ library
neighbours.py     neighbour search: spatial order, pairs, periodic shifts and images of grains
packing.py        converts grains and contacts to blocks, sites and domains, and back
memory.py         memory aligned to cache lines
"""
