"""Hertz-Mindlin against linear contacts."""
