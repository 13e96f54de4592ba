"""Laws that follow recorded tests: labkit's models, the two forms in one of them, and peers with a memory.

The deviatoric strain is that of the grains and the mean stress is held, so that dilatancy is predicted.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas
from scipy.optimize import least_squares
from scipy.stats import t

from analysis.hidden_state.law import LEAST_VOLUME, Constants
from analysis.hidden_state.table import TRAINING, Test, deviatoric, intervals, tensor
from analysis.model_benchmark.peers import FAILED, SOFT, STEP, STEPS
from labkit.errors import InputError
from labkit.micro import lode_angle, mean_stress, to_six
from labkit.model import Adaptive, ConstitutiveLaw, Failure, Model, ModelState, Problem, RateLaw, strain_control

GROUPS = {
    "cycles": ("small", "large", "loops"),
    "rotation": ("turn 0.2", "turn 0.4", "turn 0.6"),
    "reloading": ("again 0", "again 45", "again 90"),
    "monotonic": ("compression", "extension"),
}
MEMORY = {"hypoplasticity": ("R", "m_R", "m_T", "beta_r", "chi"), "sanisand": ("z_max", "c_z")}
REVERSALS = ("small", "large")  # tests of the training seeds to which MEMORY is fitted
FORMS, WITH_FABRIC = "two forms", "acst, fabric"
SHEARED = 0.1  # q/p from which Lode angles are compared
TOGETHER = {"dense": "dense, medium", "medium": "dense, medium", "loose": "loose"}
VALUES = ("D", "stress", "volume", "Lode", "A", "F")
IDENTITY = to_six(np.eye(3))


def start_of(test: Test, model: Model) -> ModelState:
    """The measured state; Lambda is such that C0 gives the mean stress of the grains."""
    A, F, Ft = (tensor(deviatoric(test[name][0])) for name in ("A", "F", "Ft"))
    state = ModelState(float(test["e"][0]), float(test["Z"][0]), float(test["Lambda"][0]), A, F, Ft)
    factor = float(test["stress"][0, :3].mean() / mean_stress(state.stress(model)))
    return dataclasses.replace(state, Lam=state.Lam * factor)


def vector_of(name: str, law: ConstitutiveLaw, test: Test, constants: Constants) -> np.ndarray:
    """The state of a law at the start of a test; that of WITH_FABRIC begins with the fabric of the grains."""
    if isinstance(law, Model):
        return start_of(test, law).vector()
    assert isinstance(law, RateLaw)
    e, stress = float(test["e"][0]), tensor(test["stress"][0])
    if name != WITH_FABRIC:
        return law.start(e, stress)
    return law.start(e, stress, fabric=tensor(deviatoric(test["A"][0])) / np.polyval(constants.A_c, e))


def held_mean_stress(n: np.ndarray, p: float) -> Any:
    """The control of a deviatoric strain along n (6,), with free volume and a mean stress p in Pa."""
    free, measure = IDENTITY[:, None].copy(), IDENTITY[None] / 3.0
    return strain_control(tensor(n))._replace(free=free, measure=measure, target=np.array([p]))


def followed(law: ConstitutiveLaw, y: np.ndarray, test: Test) -> np.ndarray:
    """States (m, n) of a law at the records of a test at held p; m is smaller if the law fails."""
    p, states, integrator = float(test["stress"][0, :3].mean()), [y], Adaptive()
    problem = Problem(law, held_mean_stress(np.zeros(6), p), law.floor(y))
    for step in deviatoric(np.diff(test["strain"], axis=0)):
        size = float(np.linalg.norm(step))
        if size > 0.0:
            problem.control = held_mean_stress(step / size, p)
            try:
                y = integrator.advance(problem, y, size)
            except Failure:
                break
            if not np.isfinite(y).all():
                break
        states.append(y)
    return np.array(states)


def errors_of(law: ConstitutiveLaw, y: np.ndarray, test: Test) -> dict[str, float]:
    """VALUES of a law in a test, and `reached`, the share of the records that it reaches (no errors below 0.1)."""
    states = followed(law, y, test)
    m = len(states)
    row = {"reached": m / len(test)}
    if row["reached"] < 0.1:
        return row
    stress, grains = np.array([law.stress(state) for state in states]), tensors(test["stress"])
    ratio, truth = (deviator_ratio(sigma) for sigma in (stress, grains))
    row["stress"] = percent(ratio - truth[:m], truth)
    volume = np.trace(law.variables(states, stress)["strain"], axis1=1, axis2=2)
    own = test["strain"][:, :3].sum(axis=1) - test["strain"][0, :3].sum()
    row["volume"] = 100.0 * rms(volume - volume[0] - own[:m]) / max(np.ptp(own), LEAST_VOLUME)
    pairs = np.array([pair for pair in intervals(test) if pair[1] < m]).reshape(-1, 2)
    if len(pairs):
        k, end = pairs.T
        size = np.linalg.norm(deviatoric(test["strain"][end] - test["strain"][k]), axis=1)
        row["D"] = rms(((volume[end] - volume[k]) - (own[end] - own[k])) / size)
    large = [np.linalg.norm(r, axis=(1, 2)) * np.sqrt(1.5) > SHEARED for r in (ratio, truth[:m])]
    if (both := large[0] & large[1]).any():
        row["Lode"] = float((lode_angle(stress) - lode_angle(grains[:m]))[both].mean())
    if isinstance(law, Model):
        for name, place in (("A", 3), ("F", 9)):
            row[name] = percent(states[:, place : place + 6] - test[name][:m], test[name])
    return row


def tensors(six: np.ndarray) -> np.ndarray:
    """Tensors (n, 3, 3) of (n, 6) in Mandel notation."""
    return np.array([tensor(one) for one in six])


def deviator_ratio(sigma: np.ndarray) -> np.ndarray:
    """s/p of stresses (n, 3, 3)."""
    return sigma / np.maximum(mean_stress(sigma), 1.0)[:, None, None] - np.eye(3)


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def percent(off: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square norm of `off` in % of the largest norm of `truth`."""
    sizes = [np.linalg.norm(values.reshape(len(values), -1), axis=1) for values in (off, truth)]
    return 100.0 * rms(sizes[0]) / float(sizes[1].max())


def with_memory(law: RateLaw, tests: Sequence[Test], constants: Constants) -> RateLaw:
    """The law with its MEMORY constants fitted to tests, from its values, within its bounds."""
    names = MEMORY[law.name]
    low, high = (np.array([law.parameters[name][k] for name in names]) for k in (1, 2))
    begin = np.array([law.values[name] for name in names])
    scale = np.maximum(begin, 1e-9)

    def law_at(x: np.ndarray) -> RateLaw:
        values = np.clip(scale * np.exp(x), low, high)
        return type(law)(**{**law.values, **dict(zip(names, values.tolist(), strict=True))})

    def off(x: np.ndarray) -> np.ndarray:
        return np.concatenate([residuals(law_at(x), test, constants) for test in tests])

    bound = (np.log(np.maximum(low, 1e-9 * scale) / scale) - 1e-9, np.log(high / scale) + 1e-9)
    found = least_squares(
        off, np.zeros(len(names)), bounds=bound, diff_step=10.0 * STEP, max_nfev=2 * STEPS, loss="soft_l1", f_scale=SOFT
    )
    return law_at(found.x)


def residuals(law: RateLaw, test: Test, constants: Constants) -> np.ndarray:
    """s/p and the volumetric strain over its range, law minus grains; FAILED at records that the law does not reach."""
    own = test["strain"][:, :3].sum(axis=1)
    rows = np.full((len(test), 7), FAILED)
    try:
        states = followed(law, vector_of(law.name, law, test, constants), test)
    except InputError:
        return rows.ravel()
    stress, m = np.array([law.stress(state) for state in states]), len(states)
    rows[:m, :6] = (deviator_ratio(stress) - deviator_ratio(tensors(test["stress"][:m])))[:, *np.triu_indices(3)]
    volume = np.trace(law.variables(states, stress)["strain"], axis1=1, axis2=2)
    rows[:m, 6] = (volume - volume[0] - own[:m] + own[0]) / max(np.ptp(own), LEAST_VOLUME)
    return np.clip(rows, -3.0, 3.0).ravel()


def fitted_memory(tests: Sequence[Test], peers: Mapping[str, RateLaw], constants: Constants) -> pandas.DataFrame:
    """The MEMORY constants as stored and as fitted to the cycles of the training packings."""
    training, rows = [test for test in tests if test.seed in TRAINING and test.name in REVERSALS], []
    for name, memory in MEMORY.items():
        fitted = with_memory(peers[name], training, constants)
        rows += [(name, constant, peers[name].values[constant], fitted.values[constant]) for constant in memory]
    return pandas.DataFrame(rows, columns=["law", "constant", "stored", "fitted"])


def with_forms(model: Model, constants: Constants) -> Model:
    """The model with both forms."""
    return dataclasses.replace(model, reversals=constants.reversals())


def contestants(
    models: dict[str, Model], peers: dict[str, RateLaw], memory: pandas.DataFrame, constants: Constants
) -> dict[str, ConstitutiveLaw]:
    """All laws by name: labkit's models, the two forms, the peers as stored and with a memory, and acst with fabric."""
    fitted = {}
    for name, own in memory.groupby("law", sort=False):
        values = dict(zip(own["constant"], own["fitted"], strict=True))
        fitted[f"{name}, reversals"] = type(peers[str(name)])(**{**peers[str(name)].values, **values})
    forms = {FORMS: with_forms(models["calibrated"], constants)}
    return {**models, **forms, **peers, **fitted, WITH_FABRIC: peers["acst"]}


def contest(
    tests: Sequence[Test],
    laws: dict[str, ConstitutiveLaw],
    constants: Constants,
    progress: Callable[[float, str], None],
) -> pandas.DataFrame:
    """Errors of all laws, a row per test of GROUPS and law."""
    group = {name: group for group, names in GROUPS.items() for name in names}
    own, rows = [test for test in tests if test.name in group], []
    for k, test in enumerate(own):
        progress(k / len(own), test.name)
        labels = {"density": test.density, "seed": test.seed, "group": group[test.name], "test": test.name}
        for name, law in laws.items():
            try:
                row = errors_of(law, vector_of(name, law, test, constants), test)
            except InputError:  # undefined at the start
                row = {"reached": 0.0}
            rows.append(labels | {"law": name} | row)
    return pandas.DataFrame(rows)


def by_packing(errors: pandas.DataFrame) -> pandas.DataFrame:
    """Means of errors over the tests of a packing: part, densities, group, law, packing, VALUES, failed, tests."""
    own = errors.assign(
        part=np.where(errors["seed"].isin(TRAINING), "training", "held out"),
        densities=errors["density"].map(TOGETHER),
        packing=errors["density"] + "-s" + errors["seed"].astype(str),
        failed=(errors["reached"] < 1.0).astype(int),
        tests=1,
    )
    keys = ["part", "densities", "group", "law", "packing"]
    means = own.groupby(keys, sort=False)[list(VALUES)].mean()
    return means.join(own.groupby(keys, sort=False)[["failed", "tests"]].sum()).reset_index()


def summary(table: pandas.DataFrame) -> pandas.DataFrame:
    """Means over packings (by_packing) with 95 % intervals (t), a row per part, densities, group and law."""
    rows = []
    for labels, own in table.groupby(["part", "densities", "group", "law"], sort=False):
        row = dict(zip(("part", "densities", "group", "law"), labels, strict=True))
        row |= {"packings": len(own), "tests": own["tests"].sum(), "failed": own["failed"].sum()}
        for name in VALUES:
            values = own[name].dropna()
            n = len(values)
            row[name] = values.mean() if n else np.nan
            row[f"{name}_within"] = t.ppf(0.975, n - 1) * values.std() / np.sqrt(n) if n > 1 else np.nan
        rows.append(row)
    return pandas.DataFrame(rows)


GAINS = ("stress", "volume", "D", "A", "F")


def gains(errors: pandas.DataFrame) -> pandas.DataFrame:
    """The two forms less the calibrated model without them, paired over held-out packings.

    Columns: densities, group, value, plain, forms, difference, within (t, 1 - 0.05/20, as there are four groups and
    five GAINS), packings, share (forms over plain).
    """
    table, rows = by_packing(errors).query("part == 'held out'"), []
    looks = len(GROUPS) * len(GAINS)
    for (densities, group), own in table.groupby(["densities", "group"], sort=False):
        for value in GAINS:
            wide = own.pivot(index="packing", columns="law", values=value)
            off, n = wide[FORMS] - wide["calibrated"], len(wide)
            within = t.ppf(1.0 - 0.025 / looks, n - 1) * off.std() / np.sqrt(n)
            means = wide["calibrated"].mean(), wide[FORMS].mean()
            rows.append((densities, group, value, *means, off.mean(), within, n, means[1] / means[0]))
    columns = "densities group value plain forms difference within packings share".split()
    return pandas.DataFrame(rows, columns=columns)


COMPARED, LOOKS = ("stress", "volume"), 24


def against_peers(errors: pandas.DataFrame, own: Sequence[str], peers: Sequence[str]) -> pandas.DataFrame:
    """labkit's laws less the best peer of a group (least mean), paired over held-out packings, dense and medium."""
    table = by_packing(errors).query("part == 'held out' and densities == 'dense, medium'")
    rows = []
    for group in GROUPS:
        for value in COMPARED:
            wide = table[table["group"] == group].pivot(index="packing", columns="law", values=value)
            best = wide[[name for name in peers if name in wide]].mean().idxmin()
            for name in own:
                off = (wide[name] - wide[best]).dropna()
                n = len(off)
                within = t.ppf(1.0 - 0.025 / LOOKS, n - 1) * off.std() / np.sqrt(n)
                verdict = "smaller" if off.mean() < -within else "larger" if off.mean() > within else "not resolved"
                means = wide[name].mean(), wide[best].mean(), off.mean()
                rows.append((group, value, name, best, *means, within, n, verdict))
    columns = "group value law best_peer own peer difference within packings verdict".split()
    return pandas.DataFrame(rows, columns=columns)
