"""Hertz-Mindlin against linear contacts: critical values and the error of C0, from the runs of campaign.yaml.

python -m analysis.laws.compare CAMPAIGN_FOLDER writes results/laws/values.csv and comparison.csv.
python -m analysis.laws.compare FULL_CAMPAIGN_FOLDER full writes full_values.csv and full_comparison.csv: with few
specimens of each kind, the scatter between seeds is assumed to be the same for all laws and densities.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas

import labkit as lk
from analysis.pages import render
from analysis.paper.ends import recorded_numbers
from analysis.places import texts
from analysis.statistics import cluster_mean, student, welch
from labkit.io import write_text

RESULTS = Path(__file__).resolve().parents[2] / "results" / "laws"
WINDOW = 0.2  # axial strain from which values are averaged, to the end
VALUES = ("M", "Z", "e", "A_zz", "F_zz", "Ft_zz", "Lambda", "p_C0/p - 1", "q_C0/q - 1", "C0 error", "overlap")


def values(file: Path) -> dict[str, float]:
    """Means over the records beyond WINDOW of a run."""
    run = lk.open_run(file)
    late = run.sel(time=run["axial_strain"].values >= WINDOW)
    p, p0 = (late.lab.mean_stress(name).values for name in ("stress", "stress_sff"))
    q, q0 = (late.lab.deviatoric_stress(name).values for name in ("stress", "stress_sff"))
    errors = {"p_C0/p - 1": p0 / p - 1.0, "q_C0/q - 1": q0 / q - 1.0, "C0 error": late.lab.sff_error().values}
    found = recorded_numbers(late).assign(overlap=late["overlap_ratio"].values, **errors)
    return found[list(VALUES)].mean().to_dict()


def all_values(folder: Path) -> pandas.DataFrame:
    """One row per complete run: law, density, seed and the values."""
    rows = []
    for file in sorted((folder / "runs").glob("cp-*.run.nc")):
        law, density, seed = file.name.removeprefix("cp-").removesuffix(".run.nc").split("-")
        if lk.open_run(file).attrs["complete"]:
            rows.append({"law": law, "density": density, "seed": seed, **values(file)})
    return pandas.DataFrame(rows)


def comparison(table: pandas.DataFrame) -> pandas.DataFrame:
    """Means with 95 % intervals by law and density, and the differences Hertz-Mindlin minus linear."""
    rows = []
    groups = [(density, rows_of) for density, rows_of in table.groupby("density")] + [("all", table)]
    for density, part in groups:
        for name in VALUES:
            a, b = (part.loc[part["law"] == law, name].to_numpy() for law in ("linear", "hertz"))
            row: dict[str, object] = {"density": density, "value": name}
            for law, sample in (("linear", a), ("hertz", b)):
                found = cluster_mean(sample)
                row |= {law: found.value, f"{law} +-": found.within, f"{law} runs": found.n}
            rows.append({**row, "difference": b.mean() - a.mean(), "difference +-": welch(a, b)})
    return pandas.DataFrame(rows)


def pooled_comparison(table: pandas.DataFrame) -> pandas.DataFrame:
    """As `comparison`, with one standard deviation for all laws and densities: that of the seeds about their means.

    `all` is the mean over densities.
    """
    groups = table.groupby(["density", "law"])
    mean, size = groups[list(VALUES)].mean(), groups.size()
    freedom = int((size - 1).sum())
    scatter = np.sqrt(((table[list(VALUES)] - groups[list(VALUES)].transform("mean")) ** 2).sum() / max(freedom, 1))
    rows = []
    densities = list(mean.index.levels[0])
    for density in (*densities, "all"):
        parts = densities if density == "all" else [density]
        for name in VALUES:
            row: dict[str, object] = {"density": density, "value": name}
            of_law: dict[str, tuple[float, float]] = {}
            for law in ("linear", "hertz"):
                value = float(np.mean([mean.loc[(part, law), name] for part in parts]))
                share = sum(1.0 / size[part, law] for part in parts) / len(parts) ** 2
                of_law[law] = value, share
                half = student(float(scatter[name] * np.sqrt(share)), freedom)
                row |= {law: value, f"{law} +-": half, f"{law} runs": sum(size[part, law] for part in parts)}
            (a, share_a), (b, share_b) = of_law["linear"], of_law["hertz"]
            error = float(scatter[name] * np.sqrt(share_a + share_b))
            rows.append({**row, "difference": b - a, "difference +-": student(error, freedom)})
    return pandas.DataFrame(rows)


def main(folder: str, size: str = "") -> None:
    """Write both tables. size: `full`, or empty for the small specimens."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    prefix, compare = ("full_", pooled_comparison) if size == "full" else ("", comparison)
    table = all_values(Path(folder))
    table.to_csv(RESULTS / f"{prefix}values.csv", index=False, float_format="%.5g")
    compared = compare(table)
    compared.to_csv(RESULTS / f"{prefix}comparison.csv", index=False, float_format="%.4g")
    print(compared.to_string(index=False, float_format="%.4g"))
    write_text(RESULTS / "README.md", page(RESULTS))


LABELS: dict[str, str] = texts(__file__)["quantities"]


def page(folder: Path) -> str:
    """README.md of the study, from the tables in its folder."""
    energy = pandas.read_csv(folder / "energy.csv")
    friction = energy.set_index(["engine", "law"])["friction loss/work"]
    values = {
        "full": named(pandas.read_csv(folder / "full_comparison.csv")),
        "small": named(pandas.read_csv(folder / "comparison.csv")),
        "energy": energy,
        "friction": friction["fused", "hertz_mindlin"] - friction["yade", "hertz_mindlin"],
    }
    return render(Path(__file__).with_name("page.md"), values)


def named(table: pandas.DataFrame) -> dict[str, object]:
    """Numbers of a comparison for the page: labelled rows, and how much lower each value is with Hertz-Mindlin."""
    table = table.rename(columns=lambda name: name.replace(" +-", "_within"))
    every = table[table["density"] == "all"].set_index("value")
    M = table[table["value"] == "M"].set_index("density")
    scale = np.where(["%" in label for label in LABELS.values()], 100.0, 1.0)
    numbers = [name for name in every.columns if name not in ("density", "linear runs", "hertz runs")]
    rows = every.loc[list(LABELS), numbers].mul(scale, axis=0).assign(label=list(LABELS.values()))
    densities = M.loc[["dense", "medium", "loose"], numbers].assign(label=lambda rows: "M, " + rows.index)
    relative = (every[["difference", "difference_within"]].div(every["linear"], axis=0) * [-1.0, 1.0]).set_axis(
        ["lower", "within"], axis=1
    )
    return {
        "runs": int(every["linear runs"].iloc[0]),
        "rows": pandas.concat([rows.iloc[:1], densities, rows.iloc[1:]]),
        **relative.to_dict("index"),
        **M.to_dict("index"),
    }


if __name__ == "__main__":
    main(*sys.argv[1:])
