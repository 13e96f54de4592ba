"""The plug-in probes: registers the command `labkit probe` and the figure envelope."""

from __future__ import annotations

from labkit.plugins import register_command
from labkit.results.figures import FIGURES

register_command(
    "probe",
    "labkit.plugins.probes.command",
    "probe a state with small increments of strain or stress in many directions",
)
FIGURES.offer("envelope", "labkit.plugins.probes.figure:envelope")
