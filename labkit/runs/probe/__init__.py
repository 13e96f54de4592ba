"""Probes of a state: small increments in many directions, and their response."""
