"""What the plug-in umat adds to labkit."""

from __future__ import annotations

from labkit.plugins import register_command

register_command(
    "umat",
    "labkit.umat.command",
    "write the model as a material law for finite-element programs (UMAT, MGIS)",
)
