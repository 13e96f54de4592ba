"""Another soil: coarse glass beads and the paper's sand, prepared and tested in the same way.

    python examples/own_material.py

The same beads on the command line; commands that use the specimen read the material from its file:

    labkit specimen --void-ratio 0.67 --grains 500 --mean-diameter 0.8mm --diameter-spread 25% --density 2500kg/m3
        --young-modulus 0.6GPa --friction 0.25 --rolling-friction 0.01 -o beads.state.nc
"""

import labkit as lk

SAND = lk.Scene()  # Table 1 of the paper
BEADS = lk.Scene(
    mean_diameter="0.8 mm",
    diameter_spread="25 %",  # diameters from 0.6 to 1.0 mm
    density="2500 kg/m3",
    young_modulus="0.6 GPa",
    friction=0.25,
    rolling_friction=0.01,
)


def results(scene):
    """Return results of the preparation and of a test at constant mean stress."""
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=500), scene)
    run = lk.run(state, lk.paths.ConstantMeanStress(pressure="300 kPa", strain=0.03)).data
    return {
        "mean stress after preparation, kPa": lk.mean_stress(lk.love_stress(state.snapshot())) / 1e3,
        "mean overlap at 300 kPa, % of D": 100 * float(run["overlap_ratio"][-1]),
        "largest stress ratio q/p": float((run.lab.deviatoric_stress() / run.lab.mean_stress()).max()),
        "change of the void ratio": float(run["void_ratio"][-1] - run["void_ratio"][0]),
    }


if __name__ == "__main__":
    sand, beads = results(SAND), results(BEADS)
    print(f"{'':34}{'sand':>10}{'beads':>10}", *(f"{k:34}{sand[k]:10.4g}{beads[k]:10.4g}" for k in sand), sep="\n")
