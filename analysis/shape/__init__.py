"""Grains that are not spheres: C0, and rolling resistance in place of shape."""
