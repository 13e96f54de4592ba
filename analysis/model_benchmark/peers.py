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
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.micro import deviator, mean_stress
from labkit.model import MODELS, RateLaw

OWN = "labkit"
ACST, LI_DAFALIAS = "acst", "Li-Dafalias"  # one law; the second is the fit of all constants, which loses the fabric
EVERY = 5  # share of the points of a test
FAILED = 1.0  # residual at points that a law does not reach
STEPS = 15  # steps of the optimiser
STEP = 1e-3  # relative step of the finite differences
SOFT = 0.3  # residual beyond which an outlier counts less
MOVED = 1.0  # rise of the cost in % without which the data are taken not to have moved a constant


def peers() -> dict[str, type[RateLaw]]:
    """The registered laws other than labkit's model, by the name of the peer."""
    found = (MODELS[name] for name in MODELS if name != OWN)
    laws = {law.name: law for law in found if issubclass(law, RateLaw)}
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
    kind: type[RateLaw],
    tests: Sequence[xr.Dataset],
    held: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
) -> RateLaw:
    """Fit the parameters of a law to tests within their bounds, from `start` or its default values.

    Those in `held` keep their values. Positive ranges are searched in logarithms. Raises InputError if the start cannot
    be evaluated.
    """
    fixed = dict(held or {})
    names = [name for name in kind.parameters if name not in fixed]
    first, low, high = (np.array([kind.parameters[name][k] for name in names]) for k in range(3))
    first = np.array([(start or {}).get(name, value) for name, value in zip(names, first, strict=True)])
    logarithmic = low > 0.0

    span = np.log(high / np.where(logarithmic, low, 1.0), where=logarithmic, out=high - low)

    def law_at(x: np.ndarray) -> RateLaw:
        values = np.where(logarithmic, low * np.exp(np.where(logarithmic, x * span, 0.0)), low + x * span)
        return kind(**fixed, **dict(zip(names, np.clip(values, low, high).tolist(), strict=True)))

    def off(x: np.ndarray) -> np.ndarray:
        try:
            return residuals(law_at(x), tests)
        except InputError:
            return np.full_like(at_start, FAILED)

    ratio = np.log(first / np.where(logarithmic, low, 1.0), where=logarithmic, out=first - low)
    x = np.clip(ratio / span, 1e-6, 1.0 - 1e-6)
    at_start = residuals(law_at(x), tests)
    found = least_squares(off, x, bounds=(0.0, 1.0), diff_step=STEP, max_nfev=STEPS, loss="soft_l1", f_scale=SOFT)
    return law_at(found.x)


def fit_with_fabric(kind: type[RateLaw], training: xr.Dataset, earlier: Mapping[str, float]) -> RateLaw:
    """Anisotropic critical state theory with k_F and e_A of the grains, the rest fitted from two starts.

    The starts are the default values and those of `earlier`, a fit in which the fabric stayed at zero and e_A therefore
    lowered e0; the smaller cost is kept.
    """
    table = fabric_constants(training)
    held = table[table["of"] == "all packings"].set_index("constant")["value"].to_dict()
    tests = [training.sel(run=name) for name in training["run"].values]
    starts = (None, {**earlier, "e0": earlier["e0"] - earlier["e_A"]})
    return min((fit_peer(kind, tests, held, start) for start in starts), key=lambda law: cost(law, tests))


def fitted_peers(data: xr.Dataset, file: Path, progress: Progress) -> dict[str, RateLaw]:
    """Peer laws by name with the parameters stored in `file`; those that it lacks are fitted and added to it."""
    stored: dict[str, dict[str, float]] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    training = training_part(data)
    tests = [training.sel(run=name) for name in training["run"].values]
    for name, kind in peers().items():
        if name not in stored:
            progress(0.0, f"fitting {name}")
            fitted = fit_with_fabric(kind, training, stored[LI_DAFALIAS]) if name == ACST else fit_peer(kind, tests)
            stored[name] = fitted.values
            file.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return {name: kind(**stored[name]) for name, kind in peers().items()}


def moved_constants(laws: Mapping[str, RateLaw], tests: Sequence[xr.Dataset]) -> pandas.DataFrame:
    """Which constants of fitted laws the data moved, a row per law and constant.

    Columns: peer, constant, default, fitted, change (% of the default), back (rise of the cost, %, if the constant has
    its default again and the others their fitted values), moved (`yes` if that is more than MOVED, `no`, or `from the
    grains` for k_F and e_A of ACST, which the fit held).
    """
    rows = []
    for peer, law in laws.items():
        least = cost(law, tests)
        for constant, (default, *_) in law.parameters.items():
            fitted = law.values[constant]
            back = 100.0 * (cost(type(law)(**{**law.values, constant: default}), tests) / least - 1.0)
            moved = "from the grains" if peer == ACST and constant in ("k_F", "e_A") else "no yes".split()[back > MOVED]
            rows.append((peer, constant, default, fitted, 100.0 * (fitted / default - 1.0), back, moved))
    return pandas.DataFrame(rows, columns="peer constant default fitted change back moved".split())
