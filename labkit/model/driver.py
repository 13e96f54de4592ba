"""Driver: loads a state of the model along a path and records the variables that a simulation records."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping

import numpy as np

from labkit.dem.conditions import condition
from labkit.dem.paths import Path
from labkit.dem.scene import Scene
from labkit.errors import InputError, PhysicsError
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.micro.tensors import to_six, to_tensor
from labkit.model.controls import GAIN, control_of
from labkit.model.integrators import Adaptive, Failure, Integrator, Problem
from labkit.model.parameters import Model
from labkit.model.rates import stress_of
from labkit.model.state import ModelState, require_density

HELD_AT_START = 0.01  # largest difference between the initial and the held stress, divided by the mean stress
PARTS = 10  # of a span between records, in which a varying control is constant
STOP_TOLERANCE = 1e-10  # strain tolerance on the end of a path that stops at a stress
RECORDED = (  # variables of a simulation that the model has too
    "axial_strain",
    "strain",
    "stress",
    "void_ratio",
    "void_ratio_nominal",
    "coordination_number",
    "mean_normalised_force",
    "contact_anisotropy",
    "normal_force_anisotropy",
    "mobilisation",
)


@dataclasses.dataclass(frozen=True)
class Result:
    """A test of the model: `vector` (n, 27) as ModelState.vector but with the strain, `stress` (n, 3, 3) Pa.

    `failure`: reason why the path could not be completed, or None. `calls`: number of evaluations of the equations.
    `travelled`: accumulated strain of the path (n,). `progress`: further variables that the path records
    (Path.recorded), name -> (n,). `ended_because`: why the path ended before its aim, else empty.
    """

    model: Model
    path: Path
    vector: np.ndarray
    stress: np.ndarray
    failure: str | None
    calls: int
    travelled: np.ndarray
    progress: Mapping[str, np.ndarray]
    ended_because: str = ""

    def __len__(self) -> int:
        return len(self.vector)

    @property
    def e(self) -> np.ndarray:
        """Void ratio, shape (n,)."""
        return self.vector[:, 0]

    @property
    def Z(self) -> np.ndarray:
        """Coordination number, shape (n,)."""
        return self.vector[:, 1]

    @property
    def Lam(self) -> np.ndarray:
        """Mean normalised force Lambda, shape (n,)."""
        return self.vector[:, 2]

    @property
    def A(self) -> np.ndarray:
        """Anisotropy of the contacts (Eq. 9), shape (n, 3, 3)."""
        return to_tensor(self.vector[:, 3:9])

    @property
    def F(self) -> np.ndarray:
        """Anisotropy of the normal force (Eq. 25), shape (n, 3, 3)."""
        return to_tensor(self.vector[:, 9:15])

    @property
    def Ft(self) -> np.ndarray:
        """Mobilisation F^t, the tangential counterpart of F (Eq. 27), shape (n, 3, 3)."""
        return to_tensor(self.vector[:, 15:21])

    @property
    def strain(self) -> np.ndarray:
        """Logarithmic strain since the start, shape (n, 3, 3), compression positive."""
        return to_tensor(self.vector[:, 21:27])

    @property
    def axial_strain(self) -> np.ndarray:
        """Axial strain, the zz component of the strain, shape (n,)."""
        return self.vector[:, 23]

    @property
    def p(self) -> np.ndarray:
        """Mean stress, shape (n,), Pa."""
        return mean_stress(self.stress)

    @property
    def q(self) -> np.ndarray:
        """Deviatoric stress sigma_zz - (sigma_xx + sigma_yy)/2, shape (n,), Pa."""
        return deviatoric_stress(self.stress)

    def state(self, record: int = -1) -> ModelState:
        """ModelState at a record."""
        return ModelState.from_vector(self.vector[record])

    def require(self) -> Result:
        """The result itself. Raises PhysicsError if the path could not be completed."""
        if self.failure:
            raise PhysicsError(self.failure)
        return self


def drive(
    model: Model,
    path: Path,
    state: ModelState,
    record_strain: float | None = None,
    integrator: Integrator | None = None,
    stop_when: str | None = None,
) -> Result:
    """Load `state` along `path` (labkit.dem.paths); returns a Result.

    record_strain: axial strain between two records (default: that of the path). integrator: default Adaptive().
    stop_when: condition (labkit.dem.conditions) that ends the test at a record. Each piece between two reversals is
    integrated separately, because the rates are discontinuous at a reversal. If the state leaves the domain of the
    equations, the result ends there and `failure` gives the reason. Raises InputError for an invalid initial state, and
    for a condition on a variable that the model does not have.
    """
    integrator = integrator or Adaptive()
    path = path.for_scene(Scene()).starting_at(float(mean_stress(state.stress(model))))  # the rate only sets the time
    interval = path.record_strain if record_strain is None else record_strain
    if not (np.isfinite(interval) and 0.0 < interval <= 1.0):
        raise InputError(field="record_strain", value=interval, allowed="e.g. 1e-3")
    _require_start(model, path, state)
    return _Test(model, path, state.vector(), integrator, _stop_condition(stop_when)).result(record_strain)


def _stop_condition(stop_when):
    return None if stop_when is None else condition(stop_when, recorded=RECORDED)


class _Test:
    """A test in progress: the state vector y, the accumulated strain, and the records so far."""

    def __init__(self, model, path, y, integrator, stop_when):
        self.model, self.path, self.y, self.integrator, self.stop_when = model, path, y, integrator, stop_when
        self.travelled, self.origin, self.failure, self.calls, self.completed = 0.0, 0.0, None, 0, 0
        self.first = _record(model, y)
        self.stress = self.first["stress"]  # at which the leg starts
        self.vectors, self.distances, self.progress = [], [], []

    def result(self, record_strain):
        self.leg = self.path.leg(0, 1.0, self.stress)
        self._keep()
        for number, (sign, spans) in enumerate(_legs(self.path, record_strain)):
            if self._ended_in(number, sign, spans):
                break
        vector = np.array(self.vectors)
        stress = to_tensor(np.array([stress_of(row, self.model.constants) for row in vector]))
        progress = {name: np.array([row[name] for row in self.progress]) for name in self.path.recorded()}
        by_condition = self.stop_when is not None and self.stop_when.holds(_record(self.model, self.y), self.first)
        last = {"strain": to_tensor(vector[-1, 21:27]), "stress": stress[-1]}
        reason = "" if self.failure or by_condition else self.path.why_ended(last, self.completed)
        distances = np.array(self.distances)
        return Result(self.model, self.path, vector, stress, self.failure, self.calls, distances, progress, reason)

    def _ended_in(self, number, sign, spans):
        """Carries out one leg; True if the path ends in it."""
        self.leg = self.path.leg(number, sign, self.stress)
        self.varies = self.leg.varies
        self.origin = self.travelled if self.leg.restarts else 0.0
        problem = Problem(self.model, control_of(self.leg, self.leg.sign))
        ended = stopped = False
        for span in spans:
            try:
                ended = self._advance(problem, span, number)
            except Failure as error:
                self.travelled += error.travelled
                held = _held_text(self.path.name, self.leg.control())
                self.failure = f"{self.leg.label}{error}{held}, after {self.travelled:.4%} strain"
                if error.travelled > 0.0:
                    self.y = error.y
                    self._keep()
                break
            self._keep()
            record = _record(self.model, self.y)
            stopped = _path_ends(self.path, record, self.travelled) or (
                self.stop_when is not None and self.stop_when.holds(record, self.first)
            )
            if ended or stopped or self.leg.stops(record, self.first):
                break
        self.calls, self.completed = self.calls + problem.calls, self.completed + ended
        self.stress = self.leg.settled(problem.stress(self.y), self.travelled - self.origin)
        return bool(self.failure) or stopped or (ended and number + 1 == self.path.legs())

    def _keep(self):
        self.vectors.append(self.y)
        self.distances.append(self.travelled)
        self.progress.append(self.leg.progress(self.travelled - self.origin))

    def _advance(self, problem, span, number):
        """Advances by `span`, or to where the leg or the path ends because of a stress; True if it ends there."""
        if self.leg.rests:
            self.travelled += span
            return False
        if self.varies:
            self._follow(problem, span)
            return False
        new = self.integrator.advance(problem, self.y, span)
        if not _leg_ends(self.path, problem, new, number):
            self.y, self.travelled = new, self.travelled + span
            return False
        low, high = 0.0, span
        while high - low > STOP_TOLERANCE:
            middle = 0.5 * (low + high)
            tried = self.integrator.advance(problem, self.y, middle)
            if _leg_ends(self.path, problem, tried, number):
                new, high = tried, middle
            else:
                low = middle
        self.y, self.travelled = new, self.travelled + high
        return True

    def _follow(self, problem, span):
        """Advances by `span` while the prescribed rates or the held stresses vary."""
        end = self.travelled + span
        while self.travelled < end:
            at = self.travelled - self.origin
            part = min(end - self.travelled, max(self.leg.next_change(at) - at, STOP_TOLERANCE))
            last = end - self.travelled - part <= 1e-12 * end
            self.y = _follow(self.integrator, problem, self.y, part, self.leg, self.leg.sign, at)
            self.travelled = end if last else self.travelled + part


def _legs(path, record_strain):
    """(sign, strains between records) of each leg, the piece between two reversals."""
    interval = record_strain or path.record_strain
    if path.reverses_on_stress:
        for leg in range(path.legs()):
            yield (-1.0) ** leg, itertools.repeat(interval)
        return
    axial, own = 0.0, path.record_lengths(record_strain)
    for leg, turn in enumerate(path.turning_points()):
        length, interval = abs(turn - axial), own[leg] if own is not None else interval
        records = max(1, int(np.ceil(length / interval * (1.0 - 1e-9))))
        spans = np.full(records, interval)
        spans[-1] = length - interval * (records - 1)
        yield (1.0 if turn > axial else -1.0), spans
        axial = turn


def _follow(integrator, problem, y, span, path, sign, travelled):
    """y after a span on which the prescribed rates or the held stresses vary.

    In each part of the span the control is constant. A held stress h approaches the target T as dh/ds = GAIN (T - h),
    so that T = h + (t - h)/(1 - exp(-GAIN ds)) brings it to its value t at the end of the part.
    """
    part = span / PARTS
    for k in range(PARTS):
        end = travelled + (k + 1) * part
        control = control_of(path, sign, end - 0.5 * part)
        held = control.measure @ to_six(problem.stress(y))
        target = held + (control_of(path, sign, end).target - held) / -np.expm1(-GAIN * part)
        problem.control = control._replace(target=target)
        y = integrator.advance(problem, y, part)
    return y


def _held_text(name, control):
    """The stresses that a path of this name holds, as text for the message of a failure."""
    return "" if control is None else f" ({name} holds {', '.join(control.names)})"


def _leg_ends(path, problem, y, leg):
    stress = problem.stress(y)
    return path.stops(float(mean_stress(stress))) or path.leg_ends(stress, leg)


def _path_ends(path, record, travelled):
    """True if the path ends at a record for a reason other than its last reversal."""
    if path.stops(float(mean_stress(record["stress"]))):
        return True
    too_far = path.reverses_on_stress and travelled >= abs(path.turning_points()[-1]) * (1.0 - 1e-9)
    return too_far or path.ends(record)


def _record(model, y):
    """The variables RECORDED of a state vector, name -> value."""
    strain = to_tensor(y[21:27])
    values = (
        strain[2, 2],
        strain,
        to_tensor(np.array(stress_of(y, model.constants))),
        *(y[0], y[0], y[1], y[2]),
        *(to_tensor(y[3:9]), to_tensor(y[9:15]), to_tensor(y[15:21])),
    )
    return dict(zip(RECORDED, values, strict=True))


def _require_start(model, path, state):
    require_density(model, state.e)
    for value, label in ((state.Z, "coordination number"), (state.Lam, "mean normalised force")):
        if value <= 0.0:
            raise InputError(f"the initial {label} is 0: a path needs contacts that carry force; give a larger value")
    control = control_of(path)
    stress = state.stress(model)
    held = control.measure @ to_six(stress)
    if control.target.size:
        off = np.abs(held - control.target).max() / max(float(mean_stress(stress)), 1e-300)
        if off > HELD_AT_START:
            raise InputError(
                f"the initial stress differs from the stress that {path.name} holds by {off:.1%} of the mean stress: "
                "bring the state to that stress first (isoc, isod), or hold its current stress"
            )
    if path.stops_early and path.stops(float(mean_stress(stress))):
        problem = f"stops {path.name} immediately, because the initial mean stress is {mean_stress(stress):g} Pa"
        value = path.parameters().get("pressure")  # None for a user's path that stops at another condition
        raise InputError(problem, field="stop_pressure", value=value, allowed="a stress reached later on the path")
