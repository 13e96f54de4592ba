"""Parameters of peer laws, fitted to the training part, and which of them the data moved."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
import xarray as xr
from scipy.optimize import least_squares

from analysis.model_benchmark.fabric import fabric_constants
from analysis.model_benchmark.score import follow_strain, training_part
from analysis.peers.laws import PEERS
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.micro import deviator, mean_stress
from labkit.model import RateLaw

OWN = "labkit"
ACST, LI_DAFALIAS = "acst", "Li-Dafalias"  # one law, with the fabric of the grains and without fabric
EVERY = 5  # share of the points of a test
FAILED = 1.0  # residual at points that a law does not reach
STEPS, ROUNDS = 15, 8  # steps of the optimiser in a round, and the largest number of rounds
ENOUGH = 0.01  # share of the cost by which a round must lower it for another to follow
STEP = 1e-3  # relative step of the finite differences
SOFT = 0.3  # residual beyond which an outlier counts less
HIGHEST = {"c_h": 1.0}  # upper bounds of the fit: the plastic modulus of SANISAND is negative beyond e = 1/c_h
MOVED = 1.0  # rise of the cost in % without which the data are taken not to have moved a constant


def peers() -> dict[str, type[RateLaw]]:
    """The laws by other authors, by the name of the peer."""
    laws = {law.name: law for law in PEERS}
    own = laws.pop(ACST)
    return laws | {LI_DAFALIAS: own, ACST: own}


def residuals(law: RateLaw, tests: Sequence[xr.Dataset]) -> np.ndarray:
    """s/p, law minus grains, and ln of the ratio of p at points of tests whose strain the law follows; finite, (n,)."""
    rows = []
    for test in tests:
        sigma = test["stress"].values
        own = np.full((len(sigma), 7), FAILED)
        states = follow_strain(law, law.start(float(test["e"][0]), sigma[0]), test)
        stress = np.array([law.stress(state) for state in states])
        p, reached = mean_stress(stress), len(states)
        held = np.maximum(p, 1.0)[:, None, None]
        off = deviator(stress) / held - deviator(sigma[:reached]) / mean_stress(sigma[:reached])[:, None, None]
        own[:reached, :6] = off[:, *np.triu_indices(3)]
        own[:reached, 6] = np.log(held[:, 0, 0] / mean_stress(sigma[:reached]))
        rows.append(np.clip(own[::EVERY], -3.0, 3.0))
    return np.concatenate(rows).ravel()


def cost(law: RateLaw, tests: Sequence[xr.Dataset]) -> float:
    """What the fit minimises: half the sum of the softened squares of the residuals; infinite if they are undefined."""
    try:
        off = residuals(law, tests) / SOFT
    except InputError:
        return np.inf
    return float(SOFT**2 * np.sum(np.sqrt(1.0 + off**2) - 1.0))


def fit_peer(
    kind: type[RateLaw], tests: Sequence[xr.Dataset], held: Mapping[str, float] | None = None, rounds: int = ROUNDS
) -> RateLaw:
    """Fit the parameters of a law to tests within their bounds, from its default values; those in `held` are kept.

    Positive ranges are searched in logarithms. Raises InputError if the defaults cannot be evaluated.
    """
    fixed = dict(held or {})
    names = [name for name in kind.parameters if name not in fixed]
    default, low, high = (np.array([kind.parameters[name][k] for name in names]) for k in range(3))
    high = np.array([HIGHEST.get(name, value) for name, value in zip(names, high, strict=True)])
    logarithmic = low > 0.0

    span = np.log(high / np.where(logarithmic, low, 1.0), where=logarithmic, out=high - low)

    def law_at(x: np.ndarray) -> RateLaw:
        values = np.where(logarithmic, low * np.exp(np.where(logarithmic, x * span, 0.0)), low + x * span)
        return kind(**fixed, **dict(zip(names, np.clip(values, low, high).tolist(), strict=True)))

    def off(x: np.ndarray) -> np.ndarray:
        try:
            return residuals(law_at(x), tests)
        except InputError:
            return np.full_like(first, FAILED)

    ratio = np.log(default / np.where(logarithmic, low, 1.0), where=logarithmic, out=default - low)
    x = np.clip(ratio / span, 1e-6, 1.0 - 1e-6)
    first = residuals(law_at(x), tests)
    least = np.inf
    for _ in range(rounds):
        found = least_squares(off, x, bounds=(0.0, 1.0), diff_step=STEP, max_nfev=STEPS, loss="soft_l1", f_scale=SOFT)
        x = np.clip(found.x, 1e-9, 1.0 - 1e-9)
        if found.cost > (1.0 - ENOUGH) * least:
            break
        least = found.cost
    return law_at(x)


def held_constants(name: str, training: xr.Dataset) -> dict[str, float]:
    """The constants of a peer that are not fitted: k_F and e_A, which are zero or those of the grains."""
    if name == LI_DAFALIAS:
        return {"k_F": 0.0, "e_A": 0.0}
    if name != ACST:
        return {}
    table = fabric_constants(training)
    return table[table["of"] == "all packings"].set_index("constant")["value"].to_dict()


def fitted_peers(data: xr.Dataset, file: Path, progress: Progress) -> dict[str, RateLaw]:
    """Peer laws by name with the parameters stored in `file`; those that it lacks are fitted and added to it."""
    stored: dict[str, dict[str, float]] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    training = training_part(data)
    tests = [training.sel(run=name) for name in training["run"].values]
    for name, kind in peers().items():
        if name not in stored:
            progress(0.0, f"fitting {name}")
            stored[name] = fit_peer(kind, tests, held_constants(name, training)).values
            file.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return {name: kind(**stored[name]) for name, kind in peers().items()}


def moved_constants(laws: Mapping[str, RateLaw], tests: Sequence[xr.Dataset]) -> pandas.DataFrame:
    """Which constants of fitted laws the data moved, a row per law and constant.

    Columns: peer, constant, default, fitted, change (% of the default), back (rise of the cost, %, if the constant has
    its default again and the others their fitted values), moved (`yes` if that is more than MOVED, `no`, or `held`
    by the fit).
    """
    rows = []
    for peer, law in laws.items():
        least = cost(law, tests)
        held = ("k_F", "e_A") if peer in (ACST, LI_DAFALIAS) else ()
        for constant, (default, *_) in law.parameters.items():
            fitted = law.values[constant]
            back = 100.0 * (cost(type(law)(**{**law.values, constant: default}), tests) / least - 1.0)
            moved = "held" if constant in held else "yes" if back > MOVED else "no"
            rows.append((peer, constant, default, fitted, 100.0 * (fitted / default - 1.0), back, moved))
    return pandas.DataFrame(rows, columns="peer constant default fitted change back moved".split())
