"""The plug-in watch: registers the command `labkit watch`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command("watch", "labkit.watch.command", "plot runs in the terminal while they are computed", after="grading")
