"""Fabric, density and shape in undrained tests: `python -m analysis.sand.fabric FOLDER [--seeds 1 2 ...]`.

The plan is analysis/plans/fabric_and_density.md. FOLDER keeps a line per specimen; finished specimens are not made
again. Without FOLDER only the tables and the figure of results/sand are written again.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
import warnings
from pathlib import Path

import numpy as np

import labkit as lk
from labkit.errors import PhysicsError
from labkit.micro import void_ratio_nominal

PRESSURE, FRICTION, STRAIN, MOST_CYCLES = 200e3, 0.5, 0.03, 20
FABRICS = ("isotropic", "deposited", "pre-extended")
# shape of the recipe, rolling friction, number of grains, void ratio of each density
SHAPES = {
    "spheres": ("sphere", 0.1, 1000, {"medium": 0.70, "loose": 0.77}),
    "rods": ("rod aspect_ratio=1.5", 0.0, 500, {"medium": 0.61, "loose": 0.68}),
}
SEEDS = {"spheres": range(11, 19), "rods": range(11, 15)}
TESTS: dict[str, lk.paths.Path] = {
    "compression": lk.paths.ConstantVolume(strain=STRAIN),
    "extension": lk.paths.ConstantVolume(strain=-STRAIN),
    "drained": lk.paths.ConstantRadialStress(pressure=PRESSURE, strain=0.05),
    "cyclic": lk.paths.UndrainedCycles(amplitude=0.25 * PRESSURE, cycles=MOST_CYCLES),
}
DEVICE = lk.Fused(threads=1, precision="mixed")


def specimen(shape: str, density: str, fabric: str, seed: int) -> lk.State:
    """Make a specimen with its fabric at its void ratio and isotropic stress. Raises PhysicsError."""
    name, rolling, grains, void_ratios = SHAPES[shape]
    scene = lk.Scene(friction=FRICTION, rolling_friction=rolling, time_step_factor=0.3)
    recipe = lk.Recipe(
        void_ratios[density],
        preparation="bisection",
        pressure=PRESSURE,
        grains=grains,
        shape=name,
        fabric=fabric,
        seed=seed,
    )
    return lk.make_specimen(recipe, scene, engine=DEVICE, progress=False)


def tested(state: lk.State, test: str) -> dict[str, object]:
    """Features of a test, and its curve: p and q over the initial p at each record of a monotonic test."""
    stop = "r_u > 0.95" if test == "cyclic" else None
    ended = ""
    try:
        run = lk.run(
            state, TESTS[test], engine=DEVICE, progress=False, inertial_number=1e-3, snapshots=2, stop_when=stop
        )
    except PhysicsError as error:
        run, ended = error.run, str(error)
    lab = run.data.lab
    p, q = lab.mean_stress().values, lab.q().values
    values: dict[str, object] = {"ended": ended, "least": float(p.min() / p[0]), "q_end": float(q[-1] / p[0])}
    if test == "cyclic":
        return values | {"cycles": float(np.nan_to_num(lab.liquefaction().cycles_to_ratio, nan=MOST_CYCLES))}
    volume = lab.volumetric_strain().values
    drained = {"largest_ratio": float((q / p).max()), "contraction": float(volume.max())} if test == "drained" else {}
    return values | drained | {"p": np.round(p / p[0], 4).tolist(), "q": np.round(q / p[0], 4).tolist()}


def examined(shape: str, density: str, fabric: str, seed: int) -> dict[str, object]:
    """Make and test a specimen; returns its labels, its state and the features of its tests."""
    row: dict[str, object] = {"shape": shape, "density": density, "fabric": fabric, "seed": seed}
    began = time.process_time()
    try:
        state = specimen(shape, density, fabric, seed)
    except PhysicsError as error:
        return row | {"failed": str(error)}
    snapshot = state.snapshot()
    measured = lk.statistics(snapshot)
    tensors = {"A": measured.contact_anisotropy, "F": measured.normal_force_anisotropy, "Ft": measured.mobilisation}
    row |= {"e": void_ratio_nominal(snapshot), "Z": measured.coordination_number}
    row |= {name: float(tensor[2, 2]) for name, tensor in tensors.items()} | {"made": time.process_time() - began}
    return row | {test: tested(state, test) for test in TESTS} | {"spent": time.process_time() - began}


def order(seeds: list[int] | None) -> list[tuple[str, str, str, int]]:
    """Specimens in the order of their tests: seeds of spheres and rods in turn, so that a part is balanced too."""
    turns = {shape: [s for s in known if seeds is None or s in seeds] for shape, known in SEEDS.items()}
    if seeds is not None:
        turns = dict.fromkeys(SHAPES, seeds)
    rounds = itertools.zip_longest(turns["spheres"], [None, *turns["rods"]])
    cells = list(itertools.product(("medium", "loose"), FABRICS))
    return [
        (shape, density, fabric, seed)
        for both in rounds
        for shape, seed in zip(SHAPES, both, strict=True)
        if seed is not None
        for density, fabric in cells
    ]


def run(folder: Path, seeds: list[int] | None) -> None:
    """Make and test the specimens that the folder lacks."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "tests.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    finished = {tuple(json.loads(line)[key] for key in ("shape", "density", "fabric", "seed")) for line in lines}
    for labels in order(seeds):
        if labels not in finished:
            row = examined(*labels)
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")
            print(*labels, row.get("failed") or f"{row['spent']:.1f} s", flush=True)


def main() -> None:
    """Run the specimens."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", help="instead of those of the plan, e.g. for a pilot")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    run(options.folder, options.seeds)


if __name__ == "__main__":
    main()
