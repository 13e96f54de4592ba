"""Scenarios in which a DEM simulation may go wrong, run and judged.

scenes      the scenarios, from scenes.yaml
laboratory  makes the specimens and runs of a case, and records the messages of labkit
cases       one function for each scene: pressure, cycles, time steps, grains, strains, restart
checks      the conditions that a case requires, and the means that it compares
measures    the checks that apply to every run
outcome     runs a case and determines its verdict
figure      the figure
study       `./lab hard-cases`
"""
