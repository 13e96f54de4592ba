"""A biaxial test as a boundary value problem: the constitutive model in finite-element programs."""
