"""Karlsruhe fine sand: grains calibrated on two tests predict eight others (analysis/plans/karlsruhe_sand.md)."""
