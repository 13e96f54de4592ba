"""Driver: loads a state of the model along a path and records the variables that a simulation records."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

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


@dataclasses.dataclass(frozen=True)
class Result:
    """A test of the model: `vector` (n, 27) as ModelState.vector but with the strain, `stress` (n, 3, 3) Pa.

    `failure`: reason why the path could not be completed, or None. `calls`: number of evaluations of the equations.
    `travelled`: accumulated strain of the path (n,). `ended_because`: why the path ended before its aim, else empty.
    """

    model: Model
    path: Path
    vector: np.ndarray
    stress: np.ndarray
    failure: str | None
    calls: int
    travelled: np.ndarray
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
) -> Result:
    """Load `state` along `path` (labkit.dem.paths); returns a Result.

    record_strain: axial strain between two records (default: that of the path). integrator: default Adaptive(). Each
    piece between two reversals is integrated separately, because the rates are discontinuous at a reversal. If the
    state leaves the domain of the equations, the result ends there and `failure` gives the reason. Raises InputError
    for an invalid initial state.
    """
    integrator = integrator or Adaptive()
    path = path.for_scene(Scene())  # its rate only sets the time axis
    interval = path.record_strain if record_strain is None else record_strain
    if not (np.isfinite(interval) and 0.0 < interval <= 1.0):
        raise InputError(field="record_strain", value=interval, allowed="e.g. 1e-3")
    _require_start(model, path, state)
    y, travelled, failure, calls = state.vector(), 0.0, None, 0
    ended = stopped = False
    vectors, clock, completed = [y], [0.0], 0
    for leg, (sign, spans) in enumerate(_legs(path, interval)):
        problem = Problem(model, control_of(path, sign))
        for span in spans:
            try:
                new, covered, ended = _advance(integrator, problem, y, span, path, sign, leg, travelled)
            except Failure as error:
                travelled += error.travelled
                failure = f"{error}{_held_text(path)}, after {travelled:.4%} strain"
                if error.travelled > 0.0:
                    vectors.append(error.y)
                    clock.append(travelled)
                break
            y, travelled = new, travelled + covered
            vectors.append(y)
            clock.append(travelled)
            stopped = _path_ends(path, problem, y, travelled)
            if ended or stopped:
                break
        calls, completed = calls + problem.calls, completed + ended
        if failure or stopped or (ended and leg + 1 == path.legs()):
            break
    vector = np.array(vectors)
    stress = to_tensor(np.array([stress_of(row, model.constants) for row in vector]))
    last = {"strain": to_tensor(vector[-1, 21:27]), "stress": stress[-1]}
    reason = "" if failure else path.why_ended(last, completed)
    return Result(model, path, vector, stress, failure, calls, np.array(clock), reason)


def _legs(path, interval):
    """(sign, strains between records) of each leg, the piece between two reversals."""
    axial = 0.0
    if path.reverses_on_stress:
        for leg in range(path.legs()):
            yield (-1.0) ** leg, itertools.repeat(interval)
        return
    for turn in path.turning_points():
        length = abs(turn - axial)
        records = max(1, int(np.ceil(length / interval * (1.0 - 1e-9))))
        spans = np.full(records, interval)
        spans[-1] = length - interval * (records - 1)
        yield (1.0 if turn > axial else -1.0), spans
        axial = turn


def _advance(integrator, problem, y, span, path, sign, leg, travelled):
    """(y after the span, strain covered, True if the leg or the path ends there)."""
    if path.varies:
        return _follow(integrator, problem, y, span, path, sign, travelled), span, False
    new = integrator.advance(problem, y, span)
    if not _leg_ends(path, problem, new, leg):
        return new, span, False
    low, high = 0.0, span
    while high - low > STOP_TOLERANCE:
        middle = 0.5 * (low + high)
        tried = integrator.advance(problem, y, middle)
        if _leg_ends(path, problem, tried, leg):
            new, high = tried, middle
        else:
            low = middle
    return new, high, True


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


def _held_text(path):
    """The stresses that a path holds, as text for the message of a failure."""
    control = path.control()
    return "" if control is None else f" ({path.name} holds {', '.join(control.names)})"


def _leg_ends(path, problem, y, leg):
    stress = problem.stress(y)
    return path.stops(float(mean_stress(stress))) or path.leg_ends(stress, leg)


def _path_ends(path, problem, y, travelled):
    """True if the path ends at a record for a reason other than its last reversal."""
    stress, strain = problem.stress(y), to_tensor(y[21:27])
    if path.stops(float(mean_stress(stress))):
        return True
    too_far = path.reverses_on_stress and travelled >= abs(path.turning_points()[-1]) * (1.0 - 1e-9)
    return too_far or path.ends({"axial_strain": strain[2, 2], "strain": strain, "stress": stress})


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
