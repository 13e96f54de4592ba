"""Studies made with labkit's public names alone: the paper's tests, speed against error, the hard cases.

`python -m analysis COMMAND` runs them, and `./lab COMMAND` in a clone; `paper/`, `speed_error/` and `hard_cases/` say
each its own options. What they find goes into `results/`.
"""
