"""How tension affects C0: tests with and without adhesion, bridges and bonds. Writes cohesion.png and cohesion.csv."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import labkit as lk

GRAINS, STRAIN, SEEDS, PRESSURES = 400, 0.05, (1, 2, 3), (20e3, 100e3, 300e3)  # Pa
SCENES = {  # the first and the fourth have no cohesion
    "hertz": lk.Scene(law="hertz_mindlin"),
    "dmt": lk.Scene(law="dmt", adhesion_energy=0.5),
    "jkr": lk.Scene(law="jkr", adhesion_energy=0.5),
    "linear": lk.Scene(law="bonded"),
    "capillary": lk.Scene(law="capillary", surface_tension=0.5),
    "bonded": lk.Scene(law="bonded", bond_strength="0.3 MPa", bond_shear_strength="0.3 MPa"),
}
rows = []
for name, pressure, seed in ((n, p, s) for n in SCENES for p in PRESSURES for s in SEEDS):
    recipe = lk.Recipe(void_ratio=0.67, grains=GRAINS, seed=seed, preparation="compression", pressure=pressure)
    state = lk.make_specimen(recipe, SCENES[name], progress=False)
    path = lk.paths.ConstantMeanStress(pressure=pressure, strain=STRAIN, rate=20.0)
    run = lk.run(lk.bond(state) if name == "bonded" else state, path, progress=False, record_strain=STRAIN / 10)
    for at in run.snapshots[1:]:
        love, c0, contacts, fabric = lk.love_stress(at), lk.sff_stress(at), at.contacts, lk.statistics(at)
        row = {"law": name, "pressure": pressure, "seed": seed, "axial_strain": at.axial_strain}
        row |= {"Z": fabric.coordination_number, "Lambda": fabric.mean_normalised_force}
        row |= {"A_zz": fabric.contact_anisotropy[2, 2], "F_zz": fabric.normal_force_anisotropy[2, 2]}
        row |= {"tension": (contacts.normal_force < 0).mean(), "apart": (contacts.overlap < 0).mean()}
        error = np.linalg.norm(c0 - love) / np.linalg.norm(love)
        rows.append({**row, "q/p": lk.deviatoric_stress(love) / pressure, "error": error})
table = pd.DataFrame(rows)
table.to_csv("cohesion.csv", index=False, float_format="%.5g")
means = table.groupby(["law", "pressure"], sort=False).mean(numeric_only=True).drop(columns=["seed", "axial_strain"])
print(means.to_string(float_format=lambda x: f"{x:.3g}"))
figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained", sharey=True)
for name in SCENES:
    axes[0].plot(means.loc[name].index / 1e3, 100.0 * means.loc[name, "error"], "o-", label=name)
    axes[1].plot(100.0 * means.loc[name, "tension"], 100.0 * means.loc[name, "error"], "o-")
axes[0].set(xlabel="mean stress (kPa)", ylabel="error of C0 against Love's stress (%)", xticks=[20, 100, 300])
axes[1].set(xlabel="contacts in tension (%)")
axes[0].legend()
figure.savefig("cohesion.png", dpi=150)
