"""The cuda engine: many States advance together on one NVIDIA GPU, or one large State.

device.py    whether a GPU can be used, and compilation for it with numba-cuda
arrays.py    arrays on the device: states, grains, neighbour lists, the grid of the search
reading.py   copies from the device while kernels run
listing.py   neighbour lists of the contacts of a State, and a State from what was read from the device
search.py    kernels that find neighbours
motion.py    kernels that move cells and grains
contacts.py  kernels of contact forces, with the contact law, and of Love's stress
build.py     compiles the kernels for one contact law
servo.py     kernels of the servo
memory.py    memory that States need
batch.py     States that advance together
engine.py    the engine: a batch of one State
pool.py      a State of a batch as an engine, and runs whose States share a batch

Each grain has a list of its neighbours and computes its own contacts. Each contact is therefore computed twice, from
the same numbers in the same order, with identical bits. No sum depends on the order in which threads run: results are
bit-identical in every run, and those of a State do not depend on the others in its batch.
"""
