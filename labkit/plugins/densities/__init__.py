"""Specimens of a given density.

preparation  e_min and e_max, specimens at a void ratio and a pressure
command      the command `labkit density`
"""
