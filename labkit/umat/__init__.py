"""The constitutive model as a material law that finite-element programs load: UMAT (Fortran) and MGIS (C).

`labkit_umat.f90` and `labkit_mgis.c` are the sources. `properties` is the table of PROPS of a model, `library` builds
the sources and calls the result from Python.
"""
