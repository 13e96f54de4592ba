"""Constitutive laws by other authors, for comparison with labkit's model: labkit.model.MODELS lists them by name.

Equations are rewritten for compression positive; their numbers are those in the original papers.
docs/peers.md lists parameters, references, and the results against which each law was checked.
"""
