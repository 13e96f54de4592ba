"""Constitutive laws by other authors: one file per law; `laws.py` registers them."""
