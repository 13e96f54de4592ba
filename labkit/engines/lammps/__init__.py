"""The engine `lammps`: LAMMPS over MPI, for specimens that one computer cannot hold.

engine        the Engine, which talks to the server
server        answers labkit's messages on rank 0; the other ranks follow
domain        the grains of one rank in LAMMPS
parts         the grains and contacts of one rank as arrays
coefficients  the contact law in LAMMPS's terms
restart       writes contact history into LAMMPS's restarts
process       starts the ranks
"""
