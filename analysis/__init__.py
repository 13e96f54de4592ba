"""Studies that use only labkit's public names: the paper's tests, speed against error, the hard cases.

Run them with `python -m analysis COMMAND`, or `./lab COMMAND` in a clone. `paper/`, `speed_error/` and `hard_cases/`
each define their own options. Results go to `results/`.
"""
