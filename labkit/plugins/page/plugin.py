"""The plug-in page: registers the command `labkit page`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command("page", "labkit.plugins.page.command", "open the laboratory in a web page", after="demo")
