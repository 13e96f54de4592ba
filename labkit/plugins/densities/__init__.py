"""Specimens of a given density.

preparation  e_min and e_max, specimens at a void ratio and a pressure, twins with fewer contacts
command      the commands `labkit density` and `twins`
"""
