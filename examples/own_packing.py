"""A packing saved by YADE as SpherePack text: 1,000 grains from 0.58 to 1.62 times the mean diameter.

    python examples/own_packing.py [fused or yade]

It is consolidated to 100 kPa and sheared in a drained test. The same on the command line:

    labkit import examples/own_packing.txt --length-unit mm -o packing.state.nc
    labkit run cr packing.state.nc --pressure 100kPa --strain 0.02 --rate 7
"""

import sys
from pathlib import Path

import labkit as lk

FILE = Path(__file__).with_suffix(".txt")
PRESSURE = "100 kPa"


def packing():
    """Return the grains at rest; the smallest grain determines the time step."""
    return lk.import_state(FILE, lk.Scene(friction=0.5), length_unit="mm")


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
