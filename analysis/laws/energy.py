"""Energy balance of sheared specimens of every contact law, on both engines.

python -m analysis.laws.energy writes results/laws/energy.csv.
"""

from __future__ import annotations

import pandas

import labkit as lk
from analysis.laws.compare import RESULTS

LAWS = ("rolling_resistance", "spring_dashpot", "springs_in_series", "hertz_mindlin", "hertz_mindlin_dashpot")
ON_YADE = ("rolling_resistance", "hertz_mindlin", "hertz_mindlin_dashpot")
HERTZIAN = "4.8 GPa"  # gives about the same overlaps as the linear laws with 0.15 GPa
STIFF = "1.5 GPa"  # linear law with a tenth of the overlaps
STRAIN, RATE = 0.05, 18


def cases() -> list[tuple[str, str, lk.Scene]]:
    """(engine, label, scene)."""
    scenes = {law: lk.Scene(law=law) for law in LAWS if "hertz" not in law}
    scenes |= {law: lk.Scene(law=law, young_modulus=HERTZIAN) for law in LAWS if "hertz" in law}
    scenes["rolling_resistance, E = 1.5 GPa"] = lk.Scene(young_modulus=STIFF)
    both = [("fused", label, scene) for label, scene in scenes.items()]
    return both + [("yade", law, scenes[law]) for law in ON_YADE]


def energy(grains: int = 500) -> pandas.DataFrame:
    """Error of the energy balance over the work, in one drained test per law and engine to STRAIN at 500 kPa."""
    rows, states = [], {}
    for engine, label, scene in cases():
        if label not in states:
            recipe = lk.Recipe(0.6, grains=grains, preparation="compression", pressure="500 kPa")
            states[label] = lk.make_specimen(recipe, scene, progress=False)
        run = lk.run(
            states[label], lk.paths.ConstantMeanStress(pressure="500 kPa", strain=STRAIN, rate=RATE),
            engine=engine, progress=False,
        )  # fmt: skip
        data = run.data
        rows.append(
            {
                "engine": engine,
                "law": label,
                "grains": states[label].number_of_grains,
                "error at the end": float(data["energy_balance_error"][-1]),
                "largest error": float(abs(data["energy_balance_error"]).max()),
                "overlap/D": float(data["overlap_ratio"].mean()),
                "friction loss/work": float(data["friction_loss"][-1] / data["cell_work"][-1]),
            }
        )
        print(rows[-1], flush=True)
    return pandas.DataFrame(rows)


if __name__ == "__main__":
    energy().to_csv(RESULTS / "energy.csv", index=False, float_format="%.3g")
