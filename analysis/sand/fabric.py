"""Fabric, density and shape in undrained tests: `python -m analysis.sand.fabric [FOLDER]`.

The plan is analysis/plans/fabric_and_density.md. FOLDER (default: results/sand) keeps a line per specimen; finished
specimens are not made again.
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
from analysis.sand.karlsruhe import RESULTS
from labkit.errors import PhysicsError
from labkit.micro import void_ratio_nominal

STORED = RESULTS / "fabric.jsonl"
PRESSURE, FRICTION, STRAIN, MOST_CYCLES = 200e3, 0.5, 0.03, 20
FABRICS = ("isotropic", "deposited", "pre-extended")
# shape of the recipe, rolling friction, number of grains, void ratio of each density
SHAPES = {
    "spheres": ("sphere", 0.1, 1000, {"medium": 0.70, "loose": 0.77}),
    "rods": ("rod aspect_ratio=1.5", 0.0, 500, {"medium": 0.61, "loose": 0.68}),
}
TOO_DENSE = {("rods", "loose", "pre-extended")}  # cells whose void ratio no friction reaches
ROUNDS = (
    ("spheres", range(11, 15)),
    ("rods", range(11, 13)),
    ("spheres", range(15, 17)),
    ("rods", range(13, 15)),
    ("spheres", range(17, 19)),
)
LABELS = ("shape", "density", "fabric", "seed")
Labels = tuple[str, str, str, int]
FIRST_SHARE, TRIALS, TOLERANCE = 0.3, 20, 0.002  # of the search for a void ratio
SLOPE = {"spheres": 0.11, "rods": 0.13}  # de/d ln(share)
TESTS: dict[str, lk.paths.Path] = {
    "compression": lk.paths.ConstantVolume(strain=STRAIN),
    "extension": lk.paths.ConstantVolume(strain=-STRAIN),
    "drained": lk.paths.ConstantRadialStress(pressure=PRESSURE, strain=0.05),
    "cyclic": lk.paths.UndrainedCycles(amplitude=0.25 * PRESSURE, cycles=MOST_CYCLES),
}
DEVICE = lk.Fused(threads=1, precision="mixed")


def specimen(labels: Labels, share: float) -> tuple[lk.State, float]:
    """Make a specimen with its fabric at its void ratio and isotropic stress. Raises PhysicsError.

    The search begins with a share of the friction, and returns the one that leads to the void ratio. It is `bisection`
    with a better start: every trial says at which share a line of the slope SLOPE would have the void ratio, and the
    next trial takes the mean of these.
    """
    shape, density, fabric, seed = labels
    name, rolling, grains, void_ratios = SHAPES[shape]
    scene = lk.Scene(friction=FRICTION, rolling_friction=rolling, time_step_factor=0.3)
    logarithms = []
    for _ in range(TRIALS):
        recipe = lk.Recipe(
            preparation="compression",
            pressure=PRESSURE,
            step1_friction=share * FRICTION,
            step1_rolling_friction=share * rolling,
            grains=grains,
            shape=name,
            fabric=fabric,
            seed=seed,
        )
        state = lk.make_specimen(recipe, scene, engine=DEVICE, progress=False)
        missing = void_ratios[density] - void_ratio_nominal(state.snapshot())
        if abs(missing) < TOLERANCE:
            return state, share
        logarithms.append(np.log(share) + missing / SLOPE[shape])
        share = float(np.exp(np.mean(logarithms)))
    raise PhysicsError(f"no friction gives a void ratio of {void_ratios[density]}: the last is off by {missing:.4f}")


def tested(state: lk.State, test: str) -> dict[str, object]:
    """Features of a test, and the stress path of a monotonic undrained one: p and q over the initial p."""
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
    if test == "drained":
        volume = lab.volumetric_strain().values
        return values | {"largest_ratio": float((q / p).max()), "contraction": float(volume.max())}
    return values | {"p": np.round(p / p[0], 4).tolist(), "q": np.round(q / p[0], 4).tolist()}


def examined(labels: Labels, share: float) -> dict[str, object]:
    """Make and test a specimen; returns its labels, its state and the features of its tests."""
    row: dict[str, object] = dict(zip(LABELS, labels, strict=True))
    began = time.process_time()
    try:
        state, share = specimen(labels, share)
    except PhysicsError as error:
        return row | {"failed": str(error)}
    snapshot = state.snapshot()
    measured = lk.statistics(snapshot)
    tensors = {"A": measured.contact_anisotropy, "F": measured.normal_force_anisotropy, "Ft": measured.mobilisation}
    row |= {"e": void_ratio_nominal(snapshot), "Z": measured.coordination_number, "share": share}
    row |= {name: float(tensor[2, 2]) for name, tensor in tensors.items()} | {"made": time.process_time() - began}
    return row | {test: tested(state, test) for test in TESTS} | {"spent": time.process_time() - began}


def order() -> list[Labels]:
    """Specimens in the order of their tests: by seed, so that what is finished is balanced."""
    return [(*cell, seed) for shape, seeds in ROUNDS for seed in seeds for cell in cells_of(shape)]


def cells_of(shape: str) -> list[tuple[str, str, str]]:
    """Return (shape, density, fabric) of the specimens of a seed."""
    cells = itertools.product((shape,), ("medium", "loose"), FABRICS)
    return [cell for cell in cells if cell not in TOO_DENSE]


def run(folder: Path) -> None:
    """Make and test the specimens that the folder lacks; a search begins where that of the last seed ended."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / STORED.name
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []
    finished = {tuple(row[label] for label in LABELS) for row in rows}
    shares = {tuple(row[label] for label in LABELS[:3]): row["share"] for row in rows if "share" in row}
    for labels in order():
        if labels not in finished:
            row = examined(labels, shares.get(labels[:3], FIRST_SHARE))
            shares[labels[:3]] = row.get("share", FIRST_SHARE)
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")
            print(*labels, row.get("failed") or f"{row['spent']:.1f} s", flush=True)


def main() -> None:
    """Run the specimens."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=STORED.parent)
    warnings.simplefilter("ignore")
    run(parser.parse_args().folder)


if __name__ == "__main__":
    main()
