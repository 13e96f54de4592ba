"""Twins by state: two histories driven to equal e, Z, Lambda, A, F, F^t, and probed in 12 directions.

    python -m analysis.hidden_state.twins RECORDS.nc PAIRS.jsonl [--until 01:10]

Finished pairs are not made again. A pair of the sort `other` has members with different kinds of history, one of the
sort `same` has members with one kind.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas

import labkit as lk
from analysis.hidden_state.loading import (
    COARSE,
    DENSITIES,
    DEVICE,
    FINE,
    FINELY,
    RATE,
    TURNED,
    from_specimen,
    held_mean_stress,
    specimen,
)
from analysis.hidden_state.nearest import OTHER, SAME, pairs_of
from analysis.hidden_state.records import kept, sections_of, strain_of_cells
from analysis.hidden_state.table import STATE, deviatoric, read, stacked, states_of, tensor
from labkit.errors import InputError, PhysicsError
from labkit.micro import branch_vectors, symmetric, to_six, void_ratio_nominal

SEEDS = (1, 3)
TESTS = ("small", "large", "compression", "extension", "turn 0.4")
ENOUGH = 0.1  # distance of a twin
LARGEST = 0.01  # norm of an increment
INCREMENTS, ROUNDS = 2, 5
STEP = 1e-3  # strain of the finite differences
PROBE = 0.002  # norm of the deviatoric strain of a probe
MOST = 20  # pairs of a sort


def directions() -> np.ndarray:
    """Twelve directions of deviatoric strain, (12, 6): shear in three planes, extension and compression, both signs."""
    shear = np.eye(6)[3:]
    axial = np.array([-0.5, -0.5, 1.0, 0.0, 0.0, 0.0]) * np.sqrt(2.0 / 3.0)
    across = np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0]) / np.sqrt(2.0)
    mixed = (axial + shear[1]) / np.sqrt(2.0)
    half = np.array([axial, across, *shear, mixed])
    return np.concatenate([half, -half])


def state_of_snapshot(snapshot: lk.Snapshot, like: lk.State) -> lk.State:
    """The grains of a snapshot at rest, with the forces of their contacts; `like` is the specimen."""
    contacts, position = snapshot.contacts, snapshot.position
    if position is None:
        raise InputError("the snapshot has no positions: take one of a run with snapshots")
    bare = branch_vectors(position, snapshot.cell, contacts.grain, np.zeros((len(contacts), 3)))
    shift = np.linalg.solve(snapshot.cell, (contacts.branch(snapshot.radius) - bare).T).T.round()
    zero = np.zeros_like(position)
    return like.at_rest().replace(
        position=position.copy(),
        cell=snapshot.cell.copy(),
        velocity=zero,
        angular_velocity=zero.copy(),
        contact_grain=contacts.grain.astype(like.contact_grain.dtype),
        contact_shift=shift.astype(like.contact_shift.dtype),
        tangential_force=contacts.tangential_force.copy(),
        rolling_moment=contacts.rolling_moment.copy(),
    )


def values_of(state: lk.State) -> dict[str, np.ndarray]:
    """e, Z, Lambda, A, F, F^t of a State."""
    snapshot = state.snapshot()
    found = lk.statistics(snapshot)
    tensors = (found.contact_anisotropy, found.normal_force_anisotropy, symmetric(found.mobilisation))
    scalars = (void_ratio_nominal(snapshot), found.coordination_number, found.mean_normalised_force)
    values = [np.array([value]) for value in scalars] + [to_six(tensor) for tensor in tensors]
    return dict(zip(STATE, values, strict=True))


class Scale:
    """Divides states by their standard deviations over all records of a density."""

    def __init__(self, rows: pandas.DataFrame) -> None:
        """`rows`: the states of a density."""
        columns = {name: stacked(rows, name) for name in STATE}
        self.size = {name: np.sqrt(((v - v.mean(axis=0)) ** 2).sum(axis=1).mean()) for name, v in columns.items()}
        self.D = float(stacked(rows, "D").std())

    def vector(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """The scaled state, (21,); the norm of a difference is the distance."""
        parts = [values[name] / self.size[name] for name in STATE]
        return np.concatenate(parts) / np.sqrt(len(STATE))


@functools.cache
def begun(density: str, seed: int) -> lk.State:
    """The specimen."""
    return specimen(density, seed)


@functools.cache
def snapshots(density: str, seed: int, test: str) -> tuple[lk.Snapshot, ...]:
    """The snapshots of a test at the records that are kept."""
    path = from_specimen(density)[test]
    turning = TURNED * float(path.strain) if test.startswith("turn") else FINE
    interval = turning if test.startswith(FINELY) else COARSE
    run = lk.run(begun(density, seed), path, engine=DEVICE, progress=False, record_strain=interval, snapshots=10_000)
    data = run.data.isel(time=np.unique(run.data["record"].values.astype(int)))
    chosen = kept(sections_of(to_six(strain_of_cells(data["cell"].values))))
    return tuple(run.snapshots[int(k)] for k in chosen)


def strained(state: lk.State, increments: np.ndarray) -> lk.State:
    """The State after some increments of strain (n, 6), each at most LARGEST."""
    for increment in increments:
        size = np.linalg.norm(increment)
        if size > 1e-6:
            six = increment * min(1.0, LARGEST / size)
            state = lk.Element(state, engine=DEVICE, rate=RATE).strain(tensor(six)).state
    return state


def driven(state: lk.State, target: np.ndarray, scale: Scale) -> tuple[lk.State, float, float]:
    """Gauss-Newton with Broyden's update towards a scaled state; (State, distance before, distance reached)."""

    def reached(x: np.ndarray) -> tuple[lk.State, np.ndarray]:
        found = strained(state, x.reshape(INCREMENTS, 6))
        return found, scale.vector(values_of(found)) - target

    x = np.zeros(6 * INCREMENTS)
    begin, off = reached(x)
    best, before = (begin, float(np.linalg.norm(off)), x, off), float(np.linalg.norm(off))
    slopes = np.stack([(reached(STEP * unit)[1] - off) / STEP for unit in np.eye(x.size)], axis=1)
    damping = 0.1
    for _ in range(ROUNDS):
        _, least, x, off = best
        if least < ENOUGH:
            break
        size = np.linalg.norm(slopes, ord=2)
        padded = np.concatenate([slopes, damping * size * np.eye(x.size)])
        step = np.linalg.lstsq(padded, np.concatenate([-off, np.zeros(x.size)]), rcond=None)[0]
        found, now = reached(x + step)
        slopes = slopes + np.outer(now - off - slopes @ step, step) / max(step @ step, 1e-12)
        if np.linalg.norm(now) < least:
            best, damping = (found, float(np.linalg.norm(now)), x + step, now), damping / 2.0
        else:
            damping *= 3.0
    return best[0], before, best[1]


def probed(state: lk.State) -> np.ndarray:
    """D in the twelve directions at held mean stress, (12,)."""
    pressure = float(lk.mean_stress(lk.love_stress(state.snapshot())))
    found = []
    for n in directions():
        path = held_mean_stress(tensor(n), PROBE, pressure)
        run = lk.run(state.at_rest(), path, engine=DEVICE, progress=False, record_strain=PROBE / 4.0, snapshots=0)
        strain = to_six(strain_of_cells(run.data["cell"].values))[-1]
        found.append(strain[:3].sum() / np.linalg.norm(deviatoric(strain)))
    return np.array(found)


def chosen_pairs(rows: pandas.DataFrame) -> Iterator[pandas.Series]:
    """Pairs of nearest states in random order, densities and sorts in turn, each pair of tests at most twice."""
    own = rows[rows["seed"].isin(SEEDS) & rows["test"].isin(TESTS)].reset_index(drop=True)
    pairs = pairs_of(own)
    labels = ("test", "seed", "record", "kind")
    sides = [own.loc[pairs[key], labels].reset_index(drop=True).add_suffix(f"_{key}") for key in ("i", "j")]
    pairs = pandas.concat([pairs, *sides], axis=1).sample(frac=1.0, random_state=1)
    pairs["rank"] = pairs.groupby(["density", "sort", "test_i", "test_j"]).cumcount()
    pairs = pairs[pairs["rank"] < 2]
    pairs["turn"] = pairs.groupby(["density", "sort"]).cumcount()
    pairs = pairs[pairs["turn"] < MOST // len(DENSITIES) + 1]
    for _, pair in pairs.sort_values(["turn", "density", "sort"]).iterrows():
        yield pair


def twin(pair: pandas.Series, scale: Scale) -> dict[str, object]:
    """Drive the second member of a pair to the state of the first, and probe both."""
    members = []
    for key in ("i", "j"):
        seed = int(pair[f"seed_{key}"])
        snapshot = snapshots(pair["density"], seed, pair[f"test_{key}"])[int(pair[f"record_{key}"])]
        members.append(state_of_snapshot(snapshot, begun(pair["density"], seed)))
    first = strained(members[0], 1e-5 * np.eye(6)[5:])  # as much at rest as the other
    state, before, distance = driven(members[1], scale.vector(values_of(first)), scale)
    D = np.array([probed(first), probed(state)]) / scale.D
    return {"before": before, "distance": distance, "first": D[0].tolist(), "second": D[1].tolist()}


def make_pairs(records: Path, file: Path) -> Iterator[str]:
    """Make the pairs that a file lacks, yielding a line about each."""
    rows = states_of(read(records))
    scales = {density: Scale(own) for density, own in rows.groupby("density")}
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    done = {json.loads(line)["name"] for line in lines}
    for pair in chosen_pairs(rows):
        ends = [f"{pair[f'test_{key}']} s{pair[f'seed_{key}']} {pair[f'record_{key}']}" for key in ("i", "j")]
        name = f"{pair['density']} {pair['sort']}: {ends[0]}, {ends[1]}"
        if name in done:
            continue
        try:
            found = twin(pair, scales[pair["density"]])
        except (PhysicsError, InputError) as error:
            found = {"failed": str(error)}
        row = {"name": name, "density": pair["density"], "sort": pair["sort"], "nearest": pair["distance"], **found}
        with file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        yield f"{time.process_time():7.1f} s {name} {found.get('before')} {found.get('distance')}"


def compared_twins(lines: Sequence[dict[str, object]]) -> tuple[pandas.DataFrame, pandas.DataFrame]:
    """(a row per pair, a row per density and sort): root mean square difference of D in the twelve directions.

    The second table ends with the ratio of `other` to `same` over all pairs, with a bootstrap over pairs.
    """
    rows = []
    for line in lines:
        if "failed" not in line:
            first, second = (np.array(line[key], float) for key in ("first", "second"))
            row = {key: line[key] for key in ("name", "density", "sort", "nearest", "before", "distance")}
            rows.append(row | {"D": float(np.sqrt(((first - second) ** 2).mean()))})
    each = pandas.DataFrame(rows)
    groups = each.groupby(["density", "sort"], sort=False)
    table = groups.agg(pairs=("D", "size"), distance=("distance", "mean"), least=("distance", "min"))
    table["D"] = np.sqrt(groups["D"].apply(lambda values: (values**2).mean()))
    generator, squares = (
        np.random.default_rng(1),
        {sort: own["D"].to_numpy() ** 2 for sort, own in each.groupby("sort")},
    )
    if len(squares) == 2:
        other, same = (generator.choice(squares[sort], (2000, squares[sort].size)).mean(1) for sort in (OTHER, SAME))
        low, high = np.quantile(np.sqrt(other / same), [0.025, 0.975])
        ratio = np.sqrt(squares[OTHER].mean() / squares[SAME].mean())
        table.loc[("all", "ratio"), ["pairs", "D", "low", "high"]] = len(each), ratio, low, high
    return each, table.reset_index()


def main() -> None:
    """Read the command line and make the pairs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("records", type=Path, help="data set of the tests")
    parser.add_argument("pairs", type=Path, help="file of the pairs, a line each")
    parser.add_argument("--until", help="time of the day, HH:MM, at which to stop")
    options = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)
    for done in make_pairs(options.records, options.pairs):
        print(done, flush=True)
        if options.until and time.strftime("%H:%M") >= options.until:
            break


if __name__ == "__main__":
    main()
