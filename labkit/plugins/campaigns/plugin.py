"""The plug-in campaigns: registers the command `labkit campaign`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command("campaign", "labkit.plugins.campaigns.command", "carry out many runs defined in one file")
