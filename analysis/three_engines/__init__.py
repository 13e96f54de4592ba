"""Three engines on the same tests: do LAMMPS, YADE and fused agree within the scatter between specimens?

runs     the tests, each on the engines that have its contact law
compare  differences between engines, with intervals, against the scatter between specimens; the figure
study    `./lab three-engines`
"""
