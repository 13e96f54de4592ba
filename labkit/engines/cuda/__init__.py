"""The cuda engine: many States advance together on one NVIDIA GPU, or one large State.

device.py    whether a GPU can be used, and compilation for it with numba-cuda
arrays.py    arrays on the device: states, grains, neighbour lists, the grid of the search
reading.py   copies from the device while kernels run
taken.py     a State made of such a copy
listing.py   neighbour lists of the contacts of a State, and the contacts of a State from them
search.py    kernels that find neighbours
motion.py    kernels that move cells and grains
contacts.py  kernels of contact forces, with the contact law, and of Love's stress
scalars.py   functions of numpy for one number
build.py     compiles the kernels for one contact law
servo.py     kernels of the servo
memory.py    memory that States take
batch.py     States that advance together
engine.py    the engine: a batch of one State
pool.py      runs whose States are in one batch

Each grain has a list of its neighbours and computes its own contacts, so each contact is computed twice, from the same
numbers in the same order, and with the same bits. No sum depends on the order in which threads run: results are
bit-identical in every run, and those of a State do not depend on the others in its batch.
"""
