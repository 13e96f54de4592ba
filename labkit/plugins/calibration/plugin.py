"""The plug-in calibration: registers the command `labkit calibrate`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command(
    "calibrate", "labkit.plugins.calibration.command", "fit the parameters of the model to runs", after="model"
)
