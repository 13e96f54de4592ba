"""The plug-in incremental: registers the command driver."""

from __future__ import annotations

from labkit.plugins import register_command

register_command("driver", "labkit.plugins.incremental.command", "carry out a test file of the Incremental Driver")
