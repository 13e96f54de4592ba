"""`./lab walls-and-gravity`: runs the scenes on YADE, or uses the stored values; writes results/walls_and_gravity."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas

import labkit as lk
from analysis.initial_fabric.states import balance_table
from analysis.places import read_yaml
from analysis.statistics import cluster_mean, corrected
from analysis.study import Figures, Study, Tables
from analysis.walls_and_gravity.deposits import consolidated
from analysis.walls_and_gravity.stress import box_rows, errors_of, instants_of, plane_rows
from labkit.engines import run_script
from labkit.errors import PhysicsError
from labkit.figures import WIDTH, new_figure
from labkit.io import reporter, write_with_provenance

SCENE = lk.Scene()
SCRIPT = Path(__file__).with_name("scenes.py")
BOXES = ("smooth", "rough")
DEPOSITS = "deposits.csv"
MARGIN = {"error": 1.0, "F": 0.02}  # %, and margin of F


class WallsAndGravity(Study):
    """Love's stress against forces on walls and planes, and the fabric of deposited grains."""

    data = "stresses.csv"

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        if "campaign" in options.steps and not options.as_is:
            run_scenes(Path(options.campaign))
        return super().prepare(options, folder, command)

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        rows, fabrics, folder = [], [], runs[0].parent.parent
        for name in BOXES:
            for one in sorted(folder.glob(f"{name}-*.npz")):
                with np.load(one) as arrays:
                    each = [row for instant in instants_of(arrays) for row in box_rows(instant, SCENE.density)]
                rows += [{"scene": name, "specimen": one.stem.partition("-")[2], **row} for row in each]
        for one in runs:
            seed = one.name.removesuffix(".run.nc").rpartition("-s")[2]
            rows += [{"scene": "plane", "specimen": seed, **row} for row in plane_rows(lk.Run.open(one))]
        for one in sorted(folder.glob("deposit-*.npz")):
            seed = one.stem.partition("-")[2]
            fabrics += [{"specimen": seed, **row} for row in consolidated(one, SCENE, int(seed))]
        for output, table in ((file, rows), (file.with_name(DEPOSITS), fabrics)):
            text = pandas.DataFrame(table).to_csv(index=False, float_format="%.7g")
            write_with_provenance(output, text, runs, command)

    def read(self, file: Path) -> tuple[pandas.DataFrame, pandas.DataFrame]:
        return pandas.read_csv(file), pandas.read_csv(file.with_name(DEPOSITS))

    def sources(self, folder: Path) -> Sequence[str | Path]:
        return [folder / self.data, folder / DEPOSITS]

    def tables(self, data: tuple[pandas.DataFrame, pandas.DataFrame]) -> Tables:
        return {"love": love_table(data[0]), "balance": deposit_table(data[1])}

    def figures(self, data: tuple[pandas.DataFrame, pandas.DataFrame], tables: Tables) -> Figures:
        figure = new_figure(WIDTH, 2.8)
        left, right = figure.subplots(1, 2)
        errors = errors_of(data[0])
        labels = []
        for number, ((scene, state), group) in enumerate(errors.groupby(["scene", "state"], sort=False)):
            labels.append(f"{scene}\n{state}")
            for shift, (component, own) in zip((-0.12, 0.12), group.groupby("component", sort=False), strict=True):
                colour, name = ("C0", "C1")[shift > 0], rf"$\sigma_{{{component}}}$" if number == 0 else None
                left.plot(np.full(len(own), number + shift), own["error"], "o", ms=3, color=colour, label=name)
        left.axhspan(-MARGIN["error"], MARGIN["error"], color="0.9", zorder=0)
        left.set(xticks=range(len(labels)), xticklabels=labels, ylabel="Love's stress over force, - 1 (%)")
        left.legend()
        last = data[1][data[1]["stage"] == "500 kPa"]
        for number, name in enumerate(("A", "F", "F_paper", "F_with_Ft")):
            right.plot(np.full(len(last), number), last[name], "o", ms=3, color="C0")
        right.axhline(0.0, color="0.7", lw=0.8, zorder=0)
        names = ["A", "F", "F, section 5.3", "F with $F^t$"]
        right.set(xticks=range(4), xticklabels=names, ylabel="along z, deposits at 500 kPa")
        return {"scenes": figure}


STUDY = WallsAndGravity()


def run_scenes(folder: Path) -> None:
    """Runs every scene on YADE that the folder does not contain yet. Raises PhysicsError if one fails."""
    folder.mkdir(parents=True, exist_ok=True)
    scenes = dict(read_yaml(Path(__file__).with_name("scenes.yaml")))
    todo = [(name, given, seed) for seed in scenes.pop("seeds") for name, given in scenes.items()]
    report = reporter("scenes")
    for done, (name, given, seed) in enumerate(todo):
        report(done / len(todo), f"{name}, seed {seed}")
        if not (folder / f"{name}-{seed}.npz").exists():
            run_scene(given, seed, folder / f"{name}-{seed}.npz")
    report(1.0, "done")


def run_scene(given: Mapping[str, Any], seed: int, output: Path) -> None:
    """Runs scenes.py in YADE. Raises PhysicsError if it fails."""
    law, radius = SCENE.contact_law.yade(SCENE), 0.5 * SCENE.mean_diameter
    assert law is not None
    friction, rolling = given["wall_friction"]
    wall = SCENE.with_friction(friction, rolling).contact_law.yade(SCENE.with_friction(friction, rolling))
    assert wall is not None
    values = {
        **{"material": law.material(radius), "wall_material": wall.material(radius)},
        **{"physics": law.physics, "law": law.law, "time_step": SCENE.time_step, "damping": SCENE.local_damping},
        **{"diameter": SCENE.mean_diameter, "spread": SCENE.diameter_spread, "seed": seed, **given},
    }
    with tempfile.TemporaryDirectory() as folder:
        arguments, made = Path(folder) / "input.json", Path(folder) / "output.npz"
        arguments.write_text(json.dumps(values))
        said = run_script(SCRIPT, [str(arguments), str(made)])
        if not made.exists():
            raise PhysicsError(f"{output.stem}: YADE wrote nothing: {said[-300:]}")
        output.write_bytes(made.read_bytes())


def love_table(values: pandas.DataFrame) -> pandas.DataFrame:
    """Part I of the plan, twelve rows: scene, state, component, error (%), ..., and what closes the balance (%)."""
    rows = []
    for key, group in errors_of(values).groupby(["scene", "state", "component"], sort=False):
        found = cluster_mean(group["error"].to_numpy())
        parts = group[["kinetic", "unbalanced", "friction"]].mean().to_dict()
        rows.append(dict(zip(("scene", "state", "component"), key, strict=True)) | found.columns("error") | parts)
    table = corrected(rows)
    return table.assign(equivalent=table["error"].abs() + table["within"] <= MARGIN["error"])


def deposit_table(fabrics: pandas.DataFrame) -> pandas.DataFrame:
    """Part II of the plan, nine rows (Holm): A in the deposit, and `balance_table` at 500 kPa."""
    stages = dict(tuple(fabrics.groupby("stage")))
    last = stages["500 kPa"]
    rows = balance_table(last).drop(columns="corrected").to_dict("records")
    before = cluster_mean(stages["deposit"]["A"].to_numpy())
    table = corrected([{"quantity": "A in the deposit", **before.columns("value")}, *rows])
    untested = {"A away from the seam": last["A_inside"], "A with the seam closed": stages["closed"]["A"]}
    extra = [{"quantity": name, **cluster_mean(values).columns("value")} for name, values in untested.items()]
    return pandas.concat([table, pandas.DataFrame(extra)], ignore_index=True)
