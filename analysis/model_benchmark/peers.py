"""Parameters of peer laws, fitted to the training part."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from analysis.model_benchmark.score import follow_strain, training_part
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.micro import deviator, mean_stress
from labkit.model import MODELS, RateLaw

OWN = "labkit"
EVERY = 5  # share of the points of a test
FAILED = 1.0  # residual at points that a law does not reach
STEPS = 15  # steps of the optimiser
STEP = 1e-3  # step of the finite differences, as a share of a parameter's range


def peers() -> list[type[RateLaw]]:
    """The registered laws other than labkit's model."""
    found = (MODELS[name] for name in MODELS if name != OWN)
    return [law for law in found if issubclass(law, RateLaw)]


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


def fit_peer(kind: type[RateLaw], tests: Sequence[xr.Dataset]) -> RateLaw:
    """Fit the parameters of a law to tests within their bounds, from its default values.

    Positive ranges are searched in logarithms. Raises InputError if the defaults cannot be evaluated.
    """
    names = list(kind.parameters)
    default, low, high = (np.array([kind.parameters[name][k] for name in names]) for k in range(3))
    logarithmic = low > 0.0

    span = np.log(high / np.where(logarithmic, low, 1.0), where=logarithmic, out=high - low)

    def law_at(x: np.ndarray) -> RateLaw:
        values = np.where(logarithmic, low * np.exp(np.where(logarithmic, x * span, 0.0)), low + x * span)
        return kind(**dict(zip(names, np.clip(values, low, high).tolist(), strict=True)))

    def off(x: np.ndarray) -> np.ndarray:
        try:
            return residuals(law_at(x), tests)
        except InputError:
            return np.full_like(first, FAILED)

    ratio = np.log(default / np.where(logarithmic, low, 1.0), where=logarithmic, out=default - low)
    start = np.clip(ratio / span, 1e-6, 1.0 - 1e-6)
    first = residuals(law_at(start), tests)
    found = least_squares(off, start, bounds=(0.0, 1.0), diff_step=STEP, max_nfev=STEPS, loss="soft_l1", f_scale=0.3)
    return law_at(found.x)


def fitted_peers(data: xr.Dataset, file: Path, progress: Progress) -> dict[str, RateLaw]:
    """Peer laws by name with the parameters stored in `file`; those that it lacks are fitted and added to it."""
    stored: dict[str, dict[str, float]] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    training = training_part(data)
    tests = [training.sel(run=name) for name in training["run"].values]
    for kind in peers():
        if kind.name not in stored:
            progress(0.0, f"fitting {kind.name}")
            stored[kind.name] = fit_peer(kind, tests).values
            file.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return {kind.name: kind(**stored[kind.name]) for kind in peers()}
