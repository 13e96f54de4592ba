"""Rotation of the principal stresses at the critical state."""
