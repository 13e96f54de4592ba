"""The constitutive model as a material law that finite-element programs load: UMAT (Fortran) and MGIS (C).

    props        the table of PROPS of a model
    library      builds the sources, and calls the compiled law from Python
    export       what `labkit umat` writes

The sources are `labkit_umat.f90` and `labkit_mgis.c`; docs/umat.md explains their use.
"""

from labkit.lazy import attach

_NAMES = {
    "properties": "props",
    "Start": "props",
    "STATE_NAMES": "props",
    "TOLERANCE": "props",
    "Library": "library",
    "build": "library",
    "copy_sources": "library",
    "missing_compilers": "library",
    "write": "export",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
