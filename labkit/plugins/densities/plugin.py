"""The plug-in densities: registers the commands `labkit density` and `twins`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command(
    "density",
    "labkit.plugins.densities.command",
    "measure e_min and e_max of a material, and relative densities",
    after="bond",
)
register_command(
    "twins",
    "labkit.plugins.densities.command",
    "make a specimen with the same e and p as another, and fewer contacts",
    after="density",
)
