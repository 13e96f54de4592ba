"""Runs in the terminal while they are computed, with the command `labkit watch`."""
