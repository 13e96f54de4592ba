"""The engine `lammps`: LAMMPS over MPI, for specimens that one computer cannot hold.

engine        the Engine, on rank 0
domain        the grains of one rank in LAMMPS
parts         the grains and contacts of one rank as arrays
records       a record from the parts of all ranks
coefficients  the contact law in LAMMPS's terms
restart       writes contact history into LAMMPS's restarts
process       starts a task on several ranks
"""
