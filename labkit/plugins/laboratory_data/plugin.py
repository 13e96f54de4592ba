"""The plug-in laboratory_data: registers the commands measured, misfit, calibrate-grains and predict."""

from __future__ import annotations

from labkit.plugins import register_command

register_command("measured", "labkit.plugins.laboratory_data.command", "read a test measured in a laboratory")
register_command("misfit", "labkit.plugins.laboratory_data.command", "compare runs with a measured test")
register_command(
    "calibrate-grains",
    "labkit.plugins.laboratory_data.command",
    "find the parameters of the grains from measured tests",
)
register_command("predict", "labkit.plugins.laboratory_data.command", "predict a test from calibrated grains")
