"""The engine `lammps`: LAMMPS over MPI, for specimens that one computer cannot hold.

engine        the Engine, which exchanges messages with the server
server        answers labkit's messages on rank 0; the other ranks repeat its calls
domain        the grains of one rank in LAMMPS
parts         the grains and contacts of one rank as arrays
coefficients  the contact law as coefficients of LAMMPS
restart       writes contact history into restart files of LAMMPS
process       starts the ranks
"""
