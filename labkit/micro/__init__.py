"""Micromechanics: numpy in, numpy out.

Each physical contact counts twice in the paper, once on each of its grains. `n n` and `n (x) f` are the
same on both sides, so that sums run over physical contacts with the weight of the two sides added.
"""
