"""Extreme scenes: each run must be right, or report which limit it exceeds, or be refused in one sentence.

Every case is a specimen and a run on the command line, in a separate process with a time limit. A run is right if it
passes the checks of `./lab hard-cases`. Cases that differ from the usual grains in the unit of stress or of density by
a power of four must give the same numbers in those units.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import re
import shlex
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import labkit as lk
from analysis.fuzz.cases import in_child
from analysis.fuzz.inputs import GIVEN
from analysis.hard_cases.checks import Check, below, true
from analysis.hard_cases.measures import common_checks, measure
from labkit.cli.dispatch import main as run_command

LIMITS = re.compile(r"above (the limit )?[0-9]|above the limit|cannot finish")  # start of the report of a limit
EXPECTED = re.compile(r"steps, about ([0-9.,]+ (min|h|days).*)")  # the first message of a command that takes long
HELD = "held:"  # checks of labkit verify
SAME = 1e-9  # relative difference of stresses in other units


@dataclasses.dataclass(frozen=True)
class Extreme:
    """A specimen and a run.

    Args:
        material: Options of both.
        path: Words of `labkit run`.
        edges: Numbers of grains along the edges of the cell, for a simple cubic lattice instead of a random specimen.
        stress: Factor of all stresses relative to the usual grains, if everything else must be equal.
        limit: Time after which the case is stopped, s.
    """

    name: str
    material: str = ""
    path: str = "cv --strain 0.02"
    void_ratio: float = 0.66
    grains: int = 200
    edges: Sequence[int] | None = None
    stress: float | None = None
    limit: float = 240.0


USUAL = Extreme("usual grains")
CASES = (
    *(Extreme(**fields) for fields in GIVEN["extremes"]),
    *(Extreme(f"{math.prod(edges)} grains, {'x'.join(map(str, edges))}", edges=edges) for edges in GIVEN["lattices"]),
)


def outcomes(engine: str) -> Iterator[tuple[Extreme, str, str]]:
    """(case, outcome, message) for every case on an engine."""
    with tempfile.TemporaryDirectory(prefix="labkit-extremes-") as folder:
        for number, extreme in enumerate(CASES):
            place = Path(folder) / f"{number}"
            place.mkdir()
            judge = _Judge(extreme, engine, place)
            outcome = in_child(judge.outcome, extreme.limit)
            said = (place / "said").read_text()
            if outcome == "HANG" and (expected := EXPECTED.search(said)):
                outcome = f"expected to take {expected[1]}"
            yield extreme, outcome, _reason(said)


class _Judge:
    """Runs a case in its folder; its messages go to the file `said` there."""

    def __init__(self, extreme: Extreme, engine: str, folder: Path) -> None:
        self.extreme, self.engine, self.folder = extreme, engine, folder
        (folder / "said").touch()

    def outcome(self) -> str:
        """`correct`, `limit reported`, `refused`, `error`, or WRONG with the checks that fail."""
        os.chdir(self.folder)
        said = os.open("said", os.O_RDWR | os.O_APPEND)
        os.dup2(said, 1), os.dup2(said, 2)
        material, path = shlex.split(self.extreme.material), shlex.split(self.extreme.path)
        if self.extreme.edges is None:
            size = f"specimen --void-ratio {self.extreme.void_ratio} --grains {self.extreme.grains} --engine fused"
            first = [*size.split(), *material, "-o", "s.state.nc"]
        else:
            Path("packing.txt").write_text(lattice(self.extreme.edges))
            first = ["import", "packing.txt", "--length-unit", "m", "-o", "s.state.nc"]
        second = ["run", path[0], "s.state.nc", *path[1:], "--engine", self.engine, "-o", "r.run.nc"]
        if code := run_command(first) or run_command(second):
            return "refused" if code == 2 else "error"
        reported = LIMITS.search(Path("said").read_text())
        failed = [check for check in self.checks() if not check.holds]
        if failed and not (reported and all(check.name.startswith(HELD) for check in failed)):
            return f"WRONG {'; '.join(map(str, failed))}"
        if failed:
            return f"limit reported, and labkit verify FAILED: {failed[0]}"
        return "limit reported" if reported else "correct"

    def checks(self) -> Iterator[Check]:
        """Checks of the run."""
        yield from common_checks(measure("r.run.nc"), judges_c0=False)
        yield true("the run is complete", lk.Run.open("r.run.nc").complete)
        if self.extreme.stress is not None:
            number = [case.name for case in CASES].index(USUAL.name)
            usual = self.folder.parent / f"{number}" / "r.run.nc"
            found, expected = (lk.open_run(file)["stress"].values for file in ("r.run.nc", usual))
            difference = np.abs(found / self.extreme.stress - expected).max() / np.abs(expected).max()
            yield below("stress, difference from that in other units", difference, SAME)


def lattice(edges: Sequence[int]) -> str:
    """A packing file with grains on a simple cubic lattice that fills its cell, overlapping by some 0.1 %."""
    radius, chance = 1e-4, np.random.default_rng(1)
    rows = [" ".join(["##PERIODIC::", *(repr(2 * radius * n) for n in edges)])]
    for place in itertools.product(*map(range, edges)):
        centre = 2 * radius * (np.array(place) + 0.5) + 2e-4 * radius * chance.standard_normal(3)
        rows.append(" ".join(map(repr, [*centre.tolist(), 1.001 * radius])))
    return "\n".join(rows) + "\n"


def _reason(said: str) -> str:
    """The last error or reported limit among the messages."""
    lines = [line.removeprefix("labkit: ") for line in said.splitlines()]
    wanted = [line for line in lines if LIMITS.search(line)]
    errors = [line for line, raw in zip(lines, said.splitlines(), strict=True) if raw.startswith("labkit: ")]
    return (errors or wanted or [""])[-1]
