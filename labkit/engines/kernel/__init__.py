"""The compiled kernel of the fused engine.

layout.py      memory layout of contacts and grains
lanes.py       vector instructions that convert records of grains to rows of a block and back
transfers.py   transfers of several records at once between sites and blocks
sites.py       records of grains and images, from which contacts read and to which they add forces
neighbours.py  which grains may touch: spatial order, pairs, periodic shifts
arranging.py   compiled loops over grains and pairs for a neighbour search
packing.py     converts grains and contacts to blocks, sites and domains, and back
contact.py     contact forces of a block, with the contact law inlined
motion.py      motion of grains and cell
steps.py       the loop over time steps
compiling.py   compiler options, and the cache of compiled code
build.py       compiles the loop for one contact law
"""
