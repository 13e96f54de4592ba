"""Constitutive laws by other authors, for comparison with labkit's model: labkit.model.MODELS lists them by name.

Each file states the equations by the number that they have in their paper, rewritten for compression positive.
docs/peers.md lists parameters and references, and what each law was checked against.
"""
