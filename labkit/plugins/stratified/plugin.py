"""The plug-in stratified: registers the command `labkit stratified`."""

from __future__ import annotations

from labkit.plugins import register_command

register_command(
    "stratified", "labkit.plugins.stratified.command", "make the stratified layer of Fig. 3, coarse over fine discs"
)
