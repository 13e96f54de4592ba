"""Driver: loads a state of the model along a path and records the variables that a simulation records."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Generator, Iterator, Mapping

import numpy as np

from labkit.errors import InputError, PhysicsError
from labkit.grains.scene import Scene
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import to_six, to_tensor
from labkit.model.controls import GAIN, control_of
from labkit.model.integrators import Adaptive, Failure, Integrator, Problem
from labkit.model.law import ConstitutiveLaw
from labkit.model.state import ModelState
from labkit.paths.ending import Cause, Ending, Endings
from labkit.paths.facts import facts_of, require_meaning
from labkit.paths.path import Path, number_of_steps
from labkit.paths.rates import on_grains
from labkit.paths.step import Here, Record, Step
from labkit.paths.walk import Material, Stop, walk
from labkit.quantities.conditions import Condition, condition
from labkit.quantities.recorded import quantity
from labkit.servo.reach import met_at_start, refusal

HELD_AT_START = 0.01  # largest difference between the initial and the held stress, divided by the mean stress
PARTS = 10  # parts of a stretch between records, in each of which a varying control is constant
STOP_TOLERANCE = 1e-10  # strain tolerance on the end of a path that stops at a stress


@dataclasses.dataclass(frozen=True, eq=False)
class Result:
    """A test of the model.

    `vector` holds the states: (n, 27) as in ModelState.vector but with the strain, or the state vectors of another law
    (labkit.model.law). `stress` (n, 3, 3) contains the stresses in Pa, `accumulated_strain` (n,) that of the
    path. `failure` is the reason why the path could not be completed, or None; `endings` says why steps, and the
    path, ended. `calls` is the number of evaluations of the equations. `progress` holds
    further variables that the path records (Path.recorded), name -> (n,).
    """

    model: ConstitutiveLaw
    path: Path
    vector: np.ndarray
    stress: np.ndarray
    failure: str | None
    calls: int
    accumulated_strain: np.ndarray
    progress: Mapping[str, np.ndarray]
    endings: Endings = dataclasses.field(default_factory=Endings)

    def __len__(self) -> int:
        return len(self.vector)

    @property
    def e(self) -> np.ndarray:
        """Void ratio, shape (n,)."""
        return self.vector[:, 0]

    @property
    def Z(self) -> np.ndarray:
        """Coordination number, shape (n,)."""
        return self._variable("coordination_number")

    @property
    def Lam(self) -> np.ndarray:
        """Mean normalised force Lambda, shape (n,)."""
        return self._variable("mean_normalised_force")

    @property
    def A(self) -> np.ndarray:
        """Anisotropy of the contacts (Eq. 9), shape (n, 3, 3)."""
        return self._variable("contact_anisotropy")

    @property
    def F(self) -> np.ndarray:
        """Anisotropy of the normal force (Eq. 25), shape (n, 3, 3)."""
        return self._variable("normal_force_anisotropy")

    @property
    def Ft(self) -> np.ndarray:
        """Mobilisation F^t, the tangential counterpart of F (Eq. 27), shape (n, 3, 3)."""
        return self._variable("mobilisation")

    @property
    def strain(self) -> np.ndarray:
        """Logarithmic strain since the start, shape (n, 3, 3), compression positive."""
        return to_tensor(self.vector[:, -6:])

    @property
    def axial_strain(self) -> np.ndarray:
        """Axial strain, the zz component of the strain, shape (n,)."""
        return self.vector[:, -4]

    @property
    def p(self) -> np.ndarray:
        """Mean stress, shape (n,), Pa."""
        return mean_stress(self.stress)

    @property
    def q(self) -> np.ndarray:
        """q of the test, shape (n,), Pa: signed if the path is axisymmetric about z, otherwise the invariant."""
        return quantity("q")({"stress": self.stress}, facts_of(self.path))

    def _variable(self, name: str) -> np.ndarray:
        value = self.model.variables(self.vector, self.stress).get(name)
        if value is None:
            raise InputError(f"the law {self.model.name} has no {name}: use `vector`, or a result of labkit's model")
        return value

    def state(self, record: int = -1) -> ModelState:
        """Return the ModelState at a record."""
        return ModelState.from_vector(self.vector[record])

    def require(self) -> Result:
        """Return the result itself. Raises PhysicsError if the path could not be completed."""
        if self.failure:
            raise PhysicsError(self.failure)
        return self


def drive(
    model: ConstitutiveLaw,
    path: Path,
    state: ModelState | np.ndarray,
    record_strain: float | None = None,
    integrator: Integrator | None = None,
    stop_when: str | None = None,
) -> Result:
    """Load a state along a path (labkit.paths.standard); returns a Result.

    Each stretch between two reversals is integrated by itself: the rates are discontinuous at a reversal. If the
    state leaves the domain of the equations, the result ends there and `failure` gives the reason. Raises InputError
    for an invalid initial state, and for a condition on a variable that the model does not have.

    Args:
        model: The model, or another law (labkit.model.law).
        path: The path.
        state: Initial state; for another law, a state vector (RateLaw.start).
        record_strain: Axial strain between two records (default: Path.record_strain).
        integrator: Integrator (default: Adaptive()).
        stop_when: Condition (labkit.quantities.conditions) that ends the test at a record.
    """
    integrator = integrator or Adaptive()
    y = state.vector() if isinstance(state, ModelState) else state
    path = on_grains(path, Scene()).starting_at(float(mean_stress(model.stress(y))))  # the rate only sets the time
    interval = path.record_strain if record_strain is None else record_strain
    if not (np.isfinite(interval) and 0.0 < interval <= 1.0):
        raise InputError(field="record_strain", value=interval, allowed="e.g. 1e-3")
    _require_start(model, path, y)
    when = None if stop_when is None else condition(stop_when, "stop_when", tuple(_record(model, y)))
    require_meaning(path, facts_of(path), when)
    return Point(model, path, y, integrator, record_strain).result(when)


class Point(Material):
    """A point of the model on its way along a path: the state vector y, the accumulated strain, and the records."""

    def __init__(
        self, model: ConstitutiveLaw, path: Path, y: np.ndarray, integrator: Integrator, record_strain: float | None
    ) -> None:
        """Start from the state vector y; `record_strain` is the user's choice, or None for the path's default."""
        self.model, self.path, self.y, self.integrator = model, path, y, integrator
        self.record_strain, self.floor = record_strain, model.floor(y)
        self.total, self.origin, self.calls = 0.0, 0.0, 0
        self.failure: str | None = None
        self.endings = Endings()
        self.last: Record = _record(model, y)
        self.here, self.facts = Here(self.last["stress"]), facts_of(path)
        if "void_ratio" in self.last:
            self.here.pores = 1.0, float(self.last["void_ratio"])
        self.rows: list[tuple[np.ndarray, float, Mapping[str, float]]] = []

    def result(self, stop_when: Condition | None) -> Result:
        """Walk along the whole path and return the Result."""
        for _ in walk(self.path, self, number_of_steps(self.path), stop_when=stop_when):
            pass
        vectors, distances, progress = zip(*self.rows, strict=True)
        vector = np.array(vectors)
        stress = np.array([self.model.stress(row) for row in vector])
        recorded = {name: np.array([row[name] for row in progress]) for name in progress[0]}
        result = self.failure, self.calls, np.array(distances), recorded, self.endings
        return Result(self.model, self.path, vector, stress, *result)

    @property
    def accumulated_strain(self) -> float:
        return self.total - self.origin

    def enter(self, number: int, step: Step) -> None:
        self.step, self.problem = step, Problem(self.model, control_of(step), self.floor)
        self.origin = 0.0 if step.programme is None else self.total
        self.drain(step, self.last["stress"])
        self.stretches = self._stretches()
        if not self.rows:
            self._keep()

    def advance(self) -> Generator[object, object, Stop]:
        length, completed = next(self.stretches)
        calls = self.problem.calls
        try:
            ended = self._advance(length)
        except Failure as error:
            self.total += error.accumulated_strain
            condition = "" if self.step.held is None else f" ({self.path.name} holds {', '.join(self.step.held.names)})"
            label = "" if self.step.programme is None else self.step.programme.label
            self.failure = f"{label}{error}{condition}, after {self.total:.4%} strain"
            if error.accumulated_strain > 0.0:
                self.y = error.y
                self._keep()
            ended = False
        else:
            self._keep()
        self.calls += self.problem.calls - calls
        too_far = self.step.length is None and self.total >= self.step.limit * (1.0 - 1e-9)
        yield from ()
        end = None if self.failure else Cause.STRESS if ended else Cause.STRAIN if completed else None
        return Stop(_record(self.model, self.y), end or (Cause.LIMIT if too_far and not self.failure else None))

    def lost(self, record: Record) -> str:
        return self.failure or ""

    def arrive(self, stop: Stop, ending: Ending | None) -> None:
        self.last, self.endings = stop.record, self.endings.after(ending)

    def _stretches(self) -> Iterator[tuple[float, bool]]:
        """Yield (strain to the next record, True if the step is then complete) for each record of a step."""
        step, interval = self.step, self.record_strain or self.path.record_strain
        if step.programme is not None:
            interval = step.programme.interval(self.record_strain, self.path.record_strain)
        if step.length is None:
            yield from itertools.repeat((interval, False))
            return
        records = max(1, int(np.ceil(step.length / interval * (1.0 - 1e-9))))
        yield from itertools.repeat((interval, False), records - 1)
        yield step.length - interval * (records - 1), True

    def _keep(self) -> None:
        programme = self.step.programme
        self.rows.append((self.y, self.total, {} if programme is None else programme.progress(self.accumulated_strain)))

    def _advance(self, length: float) -> bool:
        """Advance by `length`, or to the point at which a stress ends the step; returns True if a stress ended it."""
        step, problem = self.step, self.problem
        if step.programme is not None and step.programme.rests:
            self.total += length
            return False
        if step.varies:
            self._follow(length)
            return False
        new = self.integrator.advance(problem, self.y, length)
        if not step.ends_at(problem.stress(new)):
            self.y, self.total = new, self.total + length
            return False
        low, high = 0.0, length
        while high - low > STOP_TOLERANCE:
            middle = 0.5 * (low + high)
            tried = self.integrator.advance(problem, self.y, middle)
            if step.ends_at(problem.stress(tried)):
                new, high = tried, middle
            else:
                low = middle
        self.y, self.total = new, self.total + high
        return True

    def _follow(self, length: float) -> None:
        """Advance by `length` while the prescribed rates or the held stresses vary."""
        end = self.total + length
        while self.total < end:
            at = self.accumulated_strain
            change = math.inf if self.step.programme is None else self.step.programme.next_change(at)
            part = min(end - self.total, max(change - at, STOP_TOLERANCE))
            last = end - self.total - part <= 1e-12 * end
            self._follow_part(part, at)
            self.total = end if last else self.total + part

    def _follow_part(self, length: float, accumulated: float) -> None:
        """Advance by `length` in PARTS parts while the prescribed rates or the held stresses vary.

        Within each part the control is constant. A held stress h approaches the target T as dh/ds = GAIN (T - h), so
        T = h + (t - h)/(1 - exp(-GAIN ds)) brings h to the prescribed value t at the end of the part.
        """
        part, y = length / PARTS, self.y
        for k in range(PARTS):
            end = accumulated + (k + 1) * part
            control = control_of(self.step, end - 0.5 * part)
            stresses = control.measure @ to_six(self.problem.stress(y))
            target = stresses + (control_of(self.step, end).target - stresses) / -np.expm1(-GAIN * part)
            self.problem.control = control._replace(target=target)
            y = self.integrator.advance(self.problem, y, part)
        self.y = y


def _record(model: ConstitutiveLaw, y: np.ndarray) -> dict[str, np.ndarray]:
    """Return the variables of a state vector, name -> value."""
    return model.variables(y, model.stress(y))


def _require_start(model: ConstitutiveLaw, path: Path, y: np.ndarray) -> None:
    model.require_start(y)
    stress = model.stress(y)
    control = control_of(next(iter(path.steps_from(Here(stress)))))
    stresses = control.measure @ to_six(stress)
    if control.target.size:
        off = np.abs(stresses - control.target).max() / max(float(mean_stress(stress)), 1e-300)
        if off > HELD_AT_START:
            raise InputError(
                f"the initial stress differs from the stress that {path.name} holds by {off:.1%} of the mean stress: "
                "bring the state to that stress first (isoc, isod), or hold its current stress"
            )
    if (end := met_at_start(path, stress)) is not None:
        initial = f"{end.name.replace('the ', 'the initial ')} is {end.measured(stress):g} Pa"
        problem = f"stops {path.name} immediately, because {initial}"
        error = refusal(path, end, problem, "a stress reached later on the path")
        error.field = {"pressure": "stop_pressure"}.get(str(error.field), error.field)
        raise error
