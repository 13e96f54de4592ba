"""Scenes at which a simulation of grains may go wrong, run and judged.

scenes      the scenes, as data
laboratory  makes the specimens and runs of a case, and keeps what labkit says
cases       a case for each scene, by what goes to its limit: pressure, cycles, steps, grains, strains; restart
checks      what a case asks for, and means that are compared
measures    what every run is checked for
outcome     runs a case and gives its verdict
page        the page and its table; figure, the figure
command     `./lab hard-cases`
"""
