"""Studies that use only labkit's public names, listed in `studies.yaml`.

Run them with `python -m analysis STUDY`, or `./lab STUDY` in a clone. `study.py` is their framework, `pages.py` makes
their pages from templates. Results go to `results/`.
"""
