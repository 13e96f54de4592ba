"""The constitutive model as a material law that finite-element programs load: UMAT (Fortran) and MGIS (C).

    props        the table of PROPS of a model
    library      builds and writes the sources, and calls the compiled law from Python
    material_point   the same law in Python: many points at once

The sources are `labkit_umat.f90` and `labkit_mgis.c`; docs/umat.md explains their use.
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.plugins.umat.library import Library as Library
    from labkit.plugins.umat.library import build as build
    from labkit.plugins.umat.library import copy_sources as copy_sources
    from labkit.plugins.umat.library import missing_compilers as missing_compilers
    from labkit.plugins.umat.props import PointStart as PointStart
    from labkit.plugins.umat.props import properties as properties
else:
    __getattr__, __dir__, __all__ = attach(__name__)
