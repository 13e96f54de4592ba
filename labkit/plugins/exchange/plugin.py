"""The plug-in exchange: registers the commands import, paraview, export and statistics."""

from __future__ import annotations

from labkit.plugins import register_command

register_command("import", "labkit.plugins.exchange.command", "make a specimen from a file of another program")
register_command("paraview", "labkit.plugins.exchange.command", "write grains, contacts and cell for ParaView")
register_command("export", "labkit.plugins.exchange.command", "write tables, or files for other programs")
register_command(
    "statistics", "labkit.plugins.exchange.command", "compute the statistics of a contact list, without a simulation"
)
