"""Differentials of C0 and of C1 to C5: the change of their right-hand sides with the state and with the strain rate.

They are derived from labkit.model.equations (labkit.model.derivation) when Numba compiles them for the first time.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from labkit.model import tensors
from labkit.model.code_writer import CodeWriter
from labkit.model.compiled import instead
from labkit.model.constants import Constants
from labkit.model.derivation import FLAG, INPUTS, SIX, Branch, Differentials, Recording, Value
from labkit.model.equations import ISOTROPIC, strain_driven
from labkit.model.tensors import Six, deviatoric_part, norm, six_at

STATE = 21  # e, Z, Lambda, A, F, F^t


Derived = tuple[Branch, dict[str, Value], Branch, dict[str, Value]]  # terms, results; the same for differentials


def derive_rates() -> Derived:
    """Record C1 to C5 and their differentials; the results are named e_rate to Ft_rate and de_rate to dFt_rate.

    The inputs are the state, D, `compressing` and c; the differentials also need the inputs de to dFt, and dD.
    """
    recording = Recording()
    y, D, dy, dD = recording.state(), recording.input("D", SIX), recording.state("d"), recording.input("dD", SIX)
    compressing = recording.input("compressing", FLAG)
    rates = recording.call(
        "state_rates", recording.call("StateVariables", *y.values()), D, compressing, recording.constants()
    )
    changes = Differentials(recording, {D: dD, **{y[place]: dy[place] for place in y}})
    results = dict(zip((f"{name}_rate" for name in INPUTS.values()), rates, strict=True))
    return recording.first, results, changes.block, {f"d{name}": changes.of(rate) for name, rate in results.items()}


def derive_stress() -> Derived:
    """Record C0 and its differential; the results are sigma and dsigma, the inputs are the state, c, and de to dFt."""
    recording = Recording()
    y, dy = recording.state(), recording.state("d")
    stress = recording.call("stress_of", y, recording.constants())
    changes = Differentials(recording, {y[place]: dy[place] for place in y})
    return recording.first, {"sigma": stress}, changes.block, {"dsigma": changes.of(stress)}


READ = (
    "{0}e, {0}Z, {0}Lam = {1}[0], {1}[1], {1}[2]",
    "{0}A, {0}F, {0}Ft = six_at({1}, 3), six_at({1}, 9), six_at({1}, 15)",
)


@functools.cache
def _rates_in_python() -> Callable[..., None]:
    """Return a function that computes the differentials of C1 to C5, for Numba to compile."""
    first, _, second, differentials = derive_rates()
    writer, once, each = CodeWriter(differentials), " " * 4, " " * 8
    lines = ["def derived(y, D, compressing, c, changes, strains, out):"]
    lines += [once + line.format("", "y") for line in READ]
    lines += [*writer.block(first, once), f"{once}for k in range(strains.shape[0]):"]
    lines += [each + line.format("d", "changes[k]") for line in READ]
    lines += [f"{each}dD = six_at(strains[k], 0)", *writer.block(second, each)]
    for place, result in zip(INPUTS, differentials.values(), strict=True):
        put = (
            f"out[k, {place}] = {writer.value(result)}"
            if place < 3
            else f"put_six(out[k], {place}, {writer.six(result)})"
        )
        lines.append(each + put)
    return _function(lines)


@functools.cache
def _stress_in_python() -> Callable[..., Six]:
    """Return a function that computes the differential of C0, for Numba to compile."""
    first, _, second, differentials = derive_stress()
    writer, once = CodeWriter(differentials), " " * 4
    lines = ["def derived(y, v, c):"]
    lines += [once + line.format(prefix, array) for prefix, array in (("", "y"), ("d", "v")) for line in READ]
    lines += [
        *writer.block(first, once),
        *writer.block(second, once),
        f"{once}return {writer.value(differentials['dsigma'])}",
    ]
    return _function(lines)


def _function(lines: list[str]) -> Any:
    space: dict[str, object] = {**vars(tensors), "np": np, "identity": tensors.IDENTITY}
    exec("\n".join(lines), space)
    return space["derived"]


@instead(lambda kind: _rates_in_python())
def _rates(y, D, compressing, c, changes, strains, out):
    _rates_in_python()(y, D, compressing, c, changes, strains, out)


@instead(lambda kind: _stress_in_python())
def _stress(y, v, c):
    return _stress_in_python()(y, v, c)


def stress_rate_of(y: np.ndarray, v: np.ndarray, c: Constants) -> Six:
    """Return d sigma/dt for dy/dt = v, Pa/s: the total differential of C0.

    This is Eq. 33 with the coupled terms of A and F, which the paper leaves out.
    """
    return _stress(y, v, c)


def rates_differentials(
    y: np.ndarray,
    D: Six,
    compressing: bool,
    c: Constants,
    dy: np.ndarray,
    dD: np.ndarray,
    out: np.ndarray,
    work: np.ndarray,
) -> None:
    """Write d(dy/dt) to `out` (m, 21) for the m rows of dy (m, 21) and dD (m, 6), at state y (21,) and strain rate D.

    Where D is isotropic, |rate| is not differentiable. The mean of the two one-sided derivatives is used; in this
    mean, terms that do not change sign with the deviatoric strain rate cancel. `work` (2, at least 21) is overwritten.
    """
    _rates(y, D, compressing, c, dy, dD, out)
    if not c.total_rate and norm(deviatoric_part(D)) <= ISOTROPIC * norm(D):
        forward, backward = work[0], work[1]
        for k in range(dD.shape[0]):
            dev = deviatoric_part(six_at(dD[k], 0))
            strain_driven(y, dev, compressing, c, forward)
            strain_driven(y, -1.0 * dev, compressing, c, backward)
            for i in range(1, STATE):
                out[k, i] += 0.5 * (forward[i] - backward[i])
