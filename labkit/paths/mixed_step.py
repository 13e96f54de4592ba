"""One step of mixed control: prescribed increments of strain and of stress, applied together.

A step consists of n consecutive rows. In each row the prescribed strains E and the targets of the held stresses
change linearly with the accumulated strain t:

    D = dE/dt + sum_j x_j P_j        M_i : sigma = M_i : sigma_0 + s_i(t)        i, j = 1 ... k, k <= 6
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import symmetric, to_six
from labkit.paths.control import Control
from labkit.quantities.conditions import condition

LEAST = 1e-3  # least accumulated strain of a step: enough for a hundred time steps and for the servo to settle
STIFFNESS = 50.0  # stiffness/mean stress: a step that prescribes only stresses covers a strain |ds|/(STIFFNESS p)
LARGEST_STRAIN, LARGEST_STRESS = 10.0, 1e12  # largest changes in one step; stress in Pa
MEAN = to_six(np.eye(3) / 3.0)


@dataclasses.dataclass(frozen=True)
class MixedStep:
    """One step of a path.

    Raises InputError for values that are not finite, shapes that do not match, and a control that no material can
    follow.

    Args:
        strain: Prescribed increments of logarithmic strain, compression positive: 9 numbers of a tensor for each row;
            an antisymmetric part is a rotation.
        free: Tensors P_j, 6 numbers per tensor: xx, yy, zz, yz, xz, xy.
        measured: Tensors M_i, 6 numbers per tensor.
        stress: Increments of the k held stresses, Pa, k numbers for each row.
        absolute: True if `stress` contains the values to reach at the ends of the rows instead of increments.
        over: Accumulated strain of the step, i.e. the rate of the path times the duration of the step (default: the
            largest prescribed strain increment, or the strain that the stress increments are expected to need).
        durations: Durations of the rows in the real test that the step describes, s; used only for output.
        until: Condition (labkit.quantities.conditions) that ends the step at a record.
        records: Number of records.
        label: Name of the step in messages.
    """

    strain: tuple[float, ...] = (0.0,) * 9
    free: tuple[float, ...] = ()
    measured: tuple[float, ...] = ()
    stress: tuple[float, ...] = ()
    absolute: bool = False
    over: float | None = None
    durations: tuple[float, ...] = ()
    until: str | None = None
    records: int | None = None
    label: str = ""

    def __post_init__(self) -> None:
        """Convert and check the fields. Raises InputError."""
        for name in ("strain", "free", "measured", "stress", "durations"):
            array = np.asarray(getattr(self, name), dtype=float).ravel()
            if not np.isfinite(array).all():
                raise InputError("has a value that is not finite", field=name, allowed="finite numbers")
            object.__setattr__(self, name, tuple(array.tolist()))
        if len(self.strain) % 9 or not self.strain:
            raise InputError(f"has {len(self.strain)} numbers", field="strain", allowed="9 numbers for each row")
        k, rest = divmod(len(self.measured), 6)
        if rest or len(self.free) != 6 * k or len(self.stress) != self.rows * k:
            allowed = "6 numbers in `measured` and in `free` for each held stress, and one in `stress` for each row"
            raise InputError("does not match the held stresses", field="stress", allowed=allowed)
        if len(self.durations) not in (0, self.rows) or min(self.durations, default=0.0) < 0.0:
            raise InputError(field="durations", value=self.durations, allowed="one for each row, 0 or more")
        self._require_moderate()
        if self.until is not None:
            condition(self.until, "until")
        if k:
            self.control(np.zeros(k)).require_possible()

    def _require_moderate(self) -> None:
        strain = np.abs(np.cumsum(self.strains, axis=0)).max()
        stress = self.largest_stress
        if strain > LARGEST_STRAIN or stress > LARGEST_STRESS:
            what, most = ("strain", LARGEST_STRAIN) if strain > LARGEST_STRAIN else ("stress", LARGEST_STRESS)
            raise InputError("has an increment that is too large", field=what, allowed=f"at most {most:g}")
        if self.over is not None and not 0.0 < self.over <= 50.0:
            raise InputError(field="over", value=self.over, allowed="a number above 0, at most 50")
        if self.records is not None and not 0 < self.records <= 1_000_000:
            raise InputError(field="records", value=self.records, allowed="1 to 1000000")

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.strain) // 9

    @functools.cached_property
    def strains(self) -> np.ndarray:
        """Strain increments of the rows, (n, 3, 3)."""
        return np.reshape(self.strain, (-1, 3, 3))

    @functools.cached_property
    def stresses(self) -> np.ndarray:
        """The field `stress` as an array (n, k), Pa."""
        return np.reshape(self.stress, (self.rows, -1))

    @property
    def largest_stress(self) -> float:
        """The largest increment or value of a held stress, Pa."""
        values = self.stresses if self.absolute else np.cumsum(self.stresses, axis=0)
        return float(np.abs(values).max(initial=0.0))

    def targets(self, start: np.ndarray) -> np.ndarray:
        """Return the held stresses at the start and their targets at the ends of the rows, (n + 1, k), Pa."""
        start = np.reshape(start, (1, -1))
        return np.concatenate([start, self.stresses if self.absolute else start + np.cumsum(self.stresses, axis=0)])

    def target_at(self, completed: object, start: np.ndarray) -> np.ndarray:
        """Return the targets (..., k), Pa, when a fraction `completed` (...) of the step is done; `start` (k,), Pa."""
        done, targets = np.asarray(completed) * self.rows, self.targets(start)
        return np.stack([np.interp(done, np.arange(self.rows + 1), target) for target in targets.T], axis=-1)

    @functools.cached_property
    def measure(self) -> np.ndarray:
        """The k tensors M_i in Mandel notation, (k, 6)."""
        return to_six(tensors_of(self.measured))

    def control(self, target: object) -> Control:
        """Return the Control of the step with the targets `target`."""
        return Control(tensors_of(self.measured), tensors_of(self.free), target)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the held stresses."""
        rows_of_names = {"p": MEAN, "q": to_six(np.diag([-0.5, -0.5, 1.0]))}
        names = self.control(np.zeros(len(self.measure))).names if self.measured else ()
        rows = zip(names, self.measure, strict=True)
        return tuple(
            next((name for name, row in rows_of_names.items() if np.allclose(row, measure)), text)
            for text, measure in rows
        )

    @functools.cached_property
    def axisymmetric(self) -> bool:
        """True if x and y are equivalent in the step, and z remains a principal axis."""
        targets = np.unique(self.stresses, axis=0) if self.measured else ()
        return is_about_z(self.strains) and all(self.control(row).axisymmetric for row in targets)

    def mean_after(self, pressure: float) -> float:
        """Return the mean stress at the end, Pa; `pressure`, its initial value, if the step leaves it open."""
        weights, *_ = np.linalg.lstsq(self.measure.T, MEAN, rcond=None)
        determined = np.allclose(self.measure.T @ weights, MEAN, atol=1e-9)
        return float(weights @ self._targets_from(pressure)[-1]) if determined else pressure

    def _targets_from(self, pressure: float) -> np.ndarray:
        """Return the targets (n + 1, k), Pa, of a step that starts at the isotropic stress `pressure`, Pa."""
        return self.targets(pressure * self.measure[:, :3].sum(axis=1))

    def lengths(self, pressure: float) -> np.ndarray:
        """Return the accumulated strains of the rows, (n,), in total at least LEAST, at a mean stress `pressure`, Pa.

        If the field `over` is given, it is the total.
        """
        rate = np.abs(symmetric(self.strains)).max(axis=2, initial=0.0)
        shear = np.abs(symmetric(self.strains) * (1.0 - np.eye(3))).max(axis=(1, 2), initial=0.0)
        lengths = np.maximum(rate.max(axis=1), 2.0 * shear)
        changes = np.abs(np.diff(self._targets_from(pressure), axis=0)).max(axis=1, initial=0.0)
        if self.absolute:  # the stress at the start, and hence its change, is unknown
            changes = np.maximum(changes, 0.5 * pressure / self.rows)
        stiffness = STIFFNESS * max(pressure, self.mean_after(pressure))
        lengths = np.maximum(lengths, changes / stiffness)
        total = self.over or max(float(lengths.sum()), LEAST)
        share = lengths / lengths.sum() if lengths.sum() > 0.0 else np.full(self.rows, 1.0 / self.rows)
        return total * share


def is_about_z(tensors: np.ndarray) -> bool:
    """Return True if tensors (..., 3, 3) are diagonal with equal components in x and y."""
    diagonal = np.diagonal(tensors, axis1=-2, axis2=-1)
    return bool((tensors == diagonal[..., None] * np.eye(3)).all() and (diagonal[..., 0] == diagonal[..., 1]).all())


def tensors_of(components: Sequence[float]) -> np.ndarray:
    """Convert 6 k numbers, 6 per tensor, to tensors (k, 3, 3)."""
    return np.reshape(components, (-1, 6))[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]


def components_of(tensors: object) -> tuple[float, ...]:
    """Convert symmetric tensors (k, 3, 3) to 6 numbers per tensor: xx, yy, zz, yz, xz, xy."""
    return tuple(np.asarray(tensors, dtype=float)[..., [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]].ravel().tolist())
