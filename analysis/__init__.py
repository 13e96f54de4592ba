"""Studies that use only labkit's public names: the paper's tests, other paths and grains, speed, hard cases.

Run them with `python -m analysis STUDY`, or `./lab STUDY` in a clone. `study.py` is their frame, `pages.py` makes their
pages from templates. Results go to `results/`.
"""
