"""A first test in ten lines: prepare a specimen, shear it at constant mean stress, verify the run and plot it."""

import labkit as lk

scene = lk.Scene(friction=0.5)  # other parameters: Table 1 of the paper
state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=2000), scene)
path = lk.paths.ConstantMeanStress(pressure="300 kPa", strain=0.05)
run = lk.run(state, path, file="first_test.run.nc")  # repeat the program to resume an interrupted run
print(run, *run.exceeded, sep="\n")  # quasi-static limits exceeded, if any
for finding in lk.verify(run):  # C0 against Love's stress, held stresses, energy balance, ...
    print(finding)
run.plot().savefig("first_test.png")
