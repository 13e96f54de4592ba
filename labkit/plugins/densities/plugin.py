"""The plug-in densities: registers the command `labkit density`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command(
    "density",
    "labkit.plugins.densities.command",
    "measure e_min and e_max of a material, and relative densities",
    after="bond",
)
