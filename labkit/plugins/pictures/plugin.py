"""The plug-in pictures: registers the command `labkit picture`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command(
    "picture", "labkit.plugins.pictures.command", "draw the grains and the force chains in 3D", after="figure"
)
