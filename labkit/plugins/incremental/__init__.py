"""Input and output files of the Incremental Driver of A. Niemunis, which tests constitutive models along any path.

labkit reads its three files, test.inp, initialconditions.inp and parameters.inp, as the programmer's manual of 27 March
2020 describes them, and carries out the same test on grains or on labkit's model (`labkit driver`).
"""
