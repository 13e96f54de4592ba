"""Grains of your own shape: rigid clumps of spheres, compared with spheres of the same sizes.

    python examples/own_shape.py

The same clumps on the command line:

    labkit specimen --void-ratio 0.5 --grains 300 --shape pebble --use examples/own_shape.py -o pebbles.state.nc
"""

import labkit as lk
from labkit.micro import axis_anisotropy, branch_anisotropy


@lk.register_shape
class Pebble(lk.Shape):
    """Three spheres; only the ratios of these lengths matter."""

    name = "pebble"
    centers = ((0.0, 0.0, 0.0), (0.8, 0.0, 0.0), (0.3, 0.6, 0.0))
    radii = (1.0, 0.7, 0.6)


def results(shape):
    """Return results of a test at constant mean stress."""
    scene = lk.Scene(friction=0.4, rolling_friction=0.0)
    state = lk.make_specimen(lk.Recipe(void_ratio=0.5, grains=300, step1_rolling_friction=0.0, shape=shape), scene)
    run = lk.run(state, lk.paths.ConstantMeanStress(pressure="200 kPa", strain=0.03))
    last, stress = run.snapshots[-1], lk.love_stress(run.snapshots[-1])
    return {
        "stress ratio q/p at the end": lk.deviatoric_stress(stress) / lk.mean_stress(stress),
        "coordination number": lk.statistics(last).coordination_number,
        "anisotropy of normals, zz": lk.statistics(last).contact_anisotropy[2, 2],
        "anisotropy of branches, zz": branch_anisotropy(last)[2, 2],
        "anisotropy of long axes, zz": axis_anisotropy(last)[2, 2],
    }


if __name__ == "__main__":
    spheres, pebbles = results("sphere"), results("pebble")
    rows = (f"{k:30}{spheres[k]:10.3f}{pebbles[k]:10.3f}" for k in spheres)
    print(f"{'':30}{'spheres':>10}{'pebbles':>10}", *rows, sep="\n")
