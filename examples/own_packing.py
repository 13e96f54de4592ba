"""A packing saved by YADE as SpherePack text: 1,000 grains from 0.58 to 1.62 times the mean diameter.

    python examples/own_packing.py [fused or yade]

It is consolidated to 100 kPa and sheared in a drained test. The same on the command line, which reads many formats:

    labkit import examples/own_packing.txt --length-unit mm -o packing.state.nc
    labkit run cr packing.state.nc --pressure 100kPa --strain 0.02 --rate 7
"""

import sys
from pathlib import Path

import numpy as np

import labkit as lk

FILE = Path(__file__).with_suffix(".txt")
PRESSURE = "100 kPa"


def packing():
    """Return the grains at rest; the smallest grain determines the time step."""
    side = [float(word) for word in FILE.read_text().split()[1:4]]  # the first line is ##PERIODIC:: and three sides
    x, y, z, radius, _ = 1e-3 * np.loadtxt(FILE).T  # mm
    cell = 1e-3 * np.array(side)
    return lk.State.from_arrays(radius, np.transpose([x, y, z]), cell=cell, scene=lk.Scene(friction=0.5))


def test(state, strain, engine):
    """Run a drained triaxial test."""
    path = lk.paths.ConstantRadialStress(pressure=PRESSURE, strain=strain, rate="7 1/s")
    return lk.run(lk.consolidate(state, PRESSURE, engine=engine), path, engine=engine)


if __name__ == "__main__":
    state = packing()
    sizes = state.radius / state.radius.mean()
    print(f"{state.number_of_grains} grains, sizes {sizes.min():.2f} to {sizes.max():.2f} of the mean")
    run = test(state, 0.02, sys.argv[1] if len(sys.argv) > 1 else "fused")
    print(f"q/p {float(run.data.lab.stress_ratio()[-1]):.3f}", *run.exceeded)
    print(f"largest error of the energy balance {float(abs(run.data['energy_balance_error']).max()):.1e} of the work")
