"""Twins by state: two histories driven to equal e, Z, Lambda, A, F, F^t, probed in 12 directions and sheared on.

The plan is analysis/plans/twins.md. `./lab hidden-state FOLDER --steps twins` makes the pairs that pairs.jsonl lacks;
the scales come from the data set of the tests.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas

import labkit as lk
from analysis.hidden_state.driving import (
    ENOUGH,
    Scale,
    driven,
    probed,
    sheared_on,
    state_of_snapshot,
    strained,
    values_of,
    with_digits,
)
from analysis.hidden_state.loading import COARSE, DENSITIES, DEVICE, axial, from_specimen, specimen
from analysis.hidden_state.nearest import OTHER, SAME
from analysis.hidden_state.records import candidates_of, sections_of, strain_of_cells
from analysis.hidden_state.records import pairs_of as contacts_of
from analysis.hidden_state.table import RATES, deviatoric, read, states_of
from labkit.errors import InputError, PhysicsError
from labkit.micro import to_six

FIRST = tuple(range(21, 27))  # packings that are all paired with each other
FURTHER = {(k, k + 1): ("dense", "medium") for k in (27, 29, 31, 33)}  # two by two, and their densities
BLOCKS = FURTHER | {FIRST: tuple(DENSITIES)}  # in the order in which their pairs are made
GRAINS = 2000
RECENT = 0.02  # accumulated strain since the last reversal up to which an instant is `reversed`
MONOTONIC, REVERSED = "monotonic", "reversed"
NEARER = 1.0 / 3.0  # share of the candidate pairs that is used
MOST, MOST_PACKINGS, MOST_TESTS = 20, 3, 5  # pairs of a sort and density; of two packings of FIRST; of two tests
MOST_FURTHER = 2  # pairs of a sort of two further packings
WINDOW, INCREMENTS = 0.009, 3  # strain of a history that is driven anew, and the increments of it


@dataclasses.dataclass(frozen=True)
class Instant:
    """An instant of a history that may become a member of a pair.

    Args:
        test: Name of the history.
        seed: Seed of the packing.
        section: Number of reversals so far.
        values: e, Z, Lambda, A, F, F^t.
        state: The grains, at rest.
        begin: The grains about WINDOW earlier, from where the member is driven.
        increments: Strain of the history from there, in INCREMENTS parts, (INCREMENTS, 6).
        since: Pairs of grains in contact at the last reversal (or at the start).
    """

    test: str
    seed: int
    section: int
    values: dict[str, np.ndarray]
    state: lk.State
    begin: lk.State
    increments: np.ndarray
    since: np.ndarray

    @property
    def kind(self) -> str:
        """MONOTONIC or REVERSED."""
        return REVERSED if self.section else MONOTONIC


def histories(density: str) -> dict[str, lk.Path]:
    """The histories by name."""
    longer = from_specimen(density)
    ends = {"compression": axial(0.06), "extension": axial(-0.06)}
    return {**ends, "small": longer["small"], "large": longer["large"]}


def instants_of(run: lk.Run, begun: lk.State, test: str, seed: int) -> Iterator[Instant]:
    """The instants of a history that are monotonic or have reversed lately."""
    data = run.data.isel(time=np.unique(run.data["record"].values.astype(int)))
    strain = to_six(strain_of_cells(data["cell"].values))
    section = sections_of(strain)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(deviatoric(strain), axis=0), axis=1))])
    states = [state_of_snapshot(snapshot, begun) for snapshot in run.snapshots]
    since, turned = contacts_of(run.snapshots[0]), 0.0
    for k in range(1, len(states)):
        if section[k] > section[k - 1]:
            since, turned = contacts_of(run.snapshots[k - 1]), along[k - 1]
        if section[k] and along[k] - turned > RECENT:
            continue
        back = min(int(np.searchsorted(along, along[k] - WINDOW)), k - 1)
        parts = np.array_split(np.diff(strain[back : k + 1], axis=0), INCREMENTS)
        increments = np.array([part.sum(axis=0) for part in parts])
        yield Instant(test, seed, int(section[k]), values_of(states[k]), states[k], states[back], increments, since)


@functools.cache
def instants(density: str, seed: int) -> list[Instant]:
    """All instants of a packing."""
    begun = specimen(density, seed, GRAINS)
    found: list[Instant] = []
    for test, path in histories(density).items():
        run = lk.run(begun, path, engine=DEVICE, progress=False, record_strain=COARSE, snapshots=10_000)
        found += instants_of(run, begun, test, seed)
    return found


def sort_of(first: Instant, second: Instant) -> str | None:
    """OTHER, SAME, or None if a pair is neither."""
    if first.kind != second.kind:
        return OTHER
    alike = first.test == second.test and first.section == second.section
    return SAME if alike else None


def chosen_pairs(density: str, seeds: Sequence[int], scale: Scale) -> dict[str, list[tuple[Instant, Instant]]]:
    """The pairs of a density and of some packings in the order in which they are driven, by sort."""
    generator = np.random.default_rng(1)
    found: dict[str, list[tuple[float, Instant, Instant]]] = {OTHER: [], SAME: []}
    most = MOST_PACKINGS if seeds == FIRST else MOST_FURTHER
    for seed in seeds:
        for other in seeds:
            if seed == other:
                continue
            seconds = instants(density, other)
            x = np.array([scale.vector(one.values) for one in seconds])
            for first in instants(density, seed):
                far = np.linalg.norm(x - scale.vector(first.values), axis=1)
                for sort, pairs in found.items():
                    allowed = np.array([sort_of(first, second) == sort for second in seconds])
                    if allowed.any():
                        j = int(np.where(allowed, far, np.inf).argmin())
                        pairs.append((float(far[j]), first, seconds[j]))
    chosen: dict[str, list[tuple[Instant, Instant]]] = {}
    for sort, pairs in found.items():
        pairs.sort(key=lambda pair: pair[0])
        nearer = pairs[: round(NEARER * len(pairs))]
        order = generator.permutation(len(nearer))
        packings: dict[frozenset[int], int] = {}
        tests: dict[frozenset[str], int] = {}
        chosen[sort] = []
        for k in order:
            _, first, second = nearer[k]
            keys = frozenset((first.seed, second.seed)), frozenset((first.test, second.test))
            if packings.get(keys[0], 0) < most and tests.get(keys[1], 0) < 2 * MOST_TESTS:
                packings[keys[0]], tests[keys[1]] = packings.get(keys[0], 0) + 1, tests.get(keys[1], 0) + 1
                chosen[sort].append((first, second))
    return chosen


def member(state: lk.State, since: np.ndarray, scale: Scale) -> dict[str, Any]:
    """What is stored of a member: D, volume, the state and the candidates; and its rates, scaled, for `twin`."""
    rates = {name: values / scale.size[name] for name, values in probed(state).items()}
    hidden = candidates_of(state.snapshot(), state.scene, since)
    kept = {name: np.atleast_1d(value) for name, value in (values_of(state) | hidden).items() if name != "new"}
    return {"rates": rates, "on": sheared_on(state), "kept": kept}


def twin(first: Instant, second: Instant, scale: Scale) -> dict[str, Any]:
    """Drive the second member of a pair to the state of the first and, if they are near, probe both."""
    fixed = strained(first.state, 1e-5 * np.eye(6)[5:])  # as much at rest as the other
    target = scale.vector(values_of(fixed))
    state, before, distance = driven(second.begin, second.increments, target, scale)
    row: dict[str, Any] = {"before": round(before, 4), "distance": round(distance, 4)}
    if distance >= 2.0 * ENOUGH:
        return row
    a, b = (member(each, one.since, scale) for each, one in ((fixed, first), (state, second)))
    row["off"] = {name: with_digits(np.linalg.norm(a["rates"][name] - b["rates"][name], axis=1)) for name in RATES}
    row["D"] = [with_digits(each["rates"]["D"][:, 0]) for each in (a, b)]
    row["on"] = [with_digits(each["on"]) for each in (a, b)]
    row["state"] = {name: [with_digits(each["kept"][name]) for each in (a, b)] for name in a["kept"]}
    return row


def make_pairs(records: Path, file: Path) -> Iterator[str]:
    """Make the pairs that a file lacks, yielding a line about each."""
    rows = states_of(read(records))
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []
    done = {line["name"] for line in lines}
    twins = pandas.Series([(line["density"], line["sort"]) for line in lines if line.get("distance", 1.0) < ENOUGH])
    count = twins.value_counts().to_dict()
    scales = {density: Scale(own) for density, own in rows.groupby("density")}
    for seeds, densities in BLOCKS.items():
        queues = {}
        for density in densities:
            for sort, pairs in chosen_pairs(density, seeds, scales[density]).items():
                queues[density, sort] = iter(pairs)
            yield f"{time.process_time():7.1f} s histories {density} {seeds}"
        while queues:
            for key in list(queues):
                pair = next(queues[key], None)
                if pair is None or count.get(key, 0) >= MOST:
                    del queues[key]
                    continue
                yield from _made(key, pair, scales[key[0]], done, file, count)


def _made(
    key: tuple[str, str],
    pair: tuple[Instant, Instant],
    scale: Scale,
    done: set[str],
    file: Path,
    count: dict[tuple[str, str], int],
) -> Iterator[str]:
    names = [f"{one.test} s{one.seed} r{one.section} e {float(one.values['e'][0]):.5f}" for one in pair]
    name = f"{key[0]} {key[1]}: {names[0]}, {names[1]}"
    if name in done:
        return
    labels: dict[str, Any] = {"name": name, "density": key[0], "sort": key[1]}
    labels |= {f"{label}s": [getattr(one, label) for one in pair] for label in ("test", "seed", "section")}
    try:
        found = twin(pair[0], pair[1], scale)
    except (PhysicsError, InputError) as error:
        found = {"failed": str(error)}
    count[key] = count.get(key, 0) + (found.get("distance", 1.0) < ENOUGH)
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(labels | found) + "\n")
    yield f"{time.process_time():7.1f} s {name} {found.get('before')} {found.get('distance')}"
