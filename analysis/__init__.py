"""Studies of the paper's tests, other paths and grains, speed, and hard cases; they use only labkit's public names.

Run them with `python -m analysis STUDY`, or `./lab STUDY` in a clone. `study.py` is their framework, `pages.py` makes
their pages from templates. Results go to `results/`.
"""
