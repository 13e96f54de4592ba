"""Probes of a state: small increments in many directions, and the responses to them."""
