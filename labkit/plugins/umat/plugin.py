"""The plug-in umat: registers the command `labkit umat`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command(
    "umat", "labkit.plugins.umat.command", "write the model as a material law for finite-element programs (UMAT, MGIS)"
)
