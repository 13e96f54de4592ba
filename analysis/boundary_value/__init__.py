"""A biaxial test as a boundary value problem: the constitutive model in a finite-element program."""
