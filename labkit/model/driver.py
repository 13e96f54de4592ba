"""Driver: loads a state of the model along a path and records the variables that a simulation records."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.dem.paths import Path
from labkit.dem.scene import Scene
from labkit.errors import InputError, PhysicsError
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.model.controls import Mixed, control_of
from labkit.model.integrators import Adaptive, Failure, Integrator, Problem
from labkit.model.parameters import Model
from labkit.model.rates import stress_of
from labkit.model.state import ModelState, require_density
from labkit.model.tensors import to_six, to_tensor

HELD_AT_START = 0.01  # largest difference between the initial and the held stress, over the mean stress
STOP_TOLERANCE = 1e-10  # strain tolerance on the end of a path that stops at a stress


@dataclasses.dataclass(frozen=True)
class Result:
    """A test of the model: `vector` (n, 27) as ModelState.vector but with the strain, `stress` (n, 3, 3) Pa.

    `failure`: reason why the path ended early, or None. `calls`: number of evaluations of the equations.
    """

    model: Model
    path: Path | Mixed
    vector: np.ndarray
    stress: np.ndarray
    failure: str | None
    calls: int

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
    path: Path | Mixed,
    state: ModelState,
    record_strain: float | None = None,
    integrator: Integrator | None = None,
) -> Result:
    """Load `state` along `path` (of labkit.dem.paths or labkit.model.controls); returns a Result.

    record_strain: axial strain between two records (default: that of the path). integrator: default Adaptive(). Each
    piece between two reversals is integrated separately, because the rates are discontinuous at a reversal. If the
    state leaves the domain of the equations, the result ends there and `failure` gives the reason. Raises InputError
    for an invalid initial state.
    """
    integrator = integrator or Adaptive()
    path = path.for_scene(Scene()) if isinstance(path, Path) else path  # its rate only sets the time axis
    interval = path.record_strain if record_strain is None else record_strain
    if not (np.isfinite(interval) and 0.0 < interval <= 1.0):
        raise InputError(field="record_strain", value=interval, allowed="e.g. 1e-3")
    _require_start(model, path, state)
    y, travelled, failure, stopped, calls = state.vector(), 0.0, None, False, 0
    vectors = [y]
    for sign, spans in _pieces(path, interval):
        problem = Problem(model, control_of(path, sign))
        for span in spans:
            try:
                new, covered, stopped = _advance(integrator, problem, y, span, path)
            except Failure as error:
                travelled += error.travelled
                failure = f"{error}, after {travelled:.4%} strain"
                if error.travelled > 0.0:
                    vectors.append(error.y)
                break
            y, travelled = new, travelled + covered
            vectors.append(y)
            if stopped:
                break
        calls += problem.calls
        if failure or stopped:
            break
    vector = np.array(vectors)
    stress = to_tensor(np.array([stress_of(row, model.constants) for row in vector]))
    return Result(model, path, vector, stress, failure, calls)


def _pieces(path, interval):
    """(sign, strains between records) of each piece between two reversals."""
    axial = 0.0
    for turn in path.turning_points():
        length = abs(turn - axial)
        records = max(1, int(np.ceil(length / interval * (1.0 - 1e-9))))
        spans = np.full(records, interval)
        spans[-1] = length - interval * (records - 1)
        yield (1.0 if turn > axial else -1.0), spans
        axial = turn


def _advance(integrator, problem, y, span, path):
    """(y after the span, strain covered, True if the path stops there)."""
    new = integrator.advance(problem, y, span)
    if not path.stops_early or not path.stops(_pressure(problem, new)):
        return new, span, False
    low, high = 0.0, span
    while high - low > STOP_TOLERANCE:
        middle = 0.5 * (low + high)
        tried = integrator.advance(problem, y, middle)
        if path.stops(_pressure(problem, tried)):
            new, high = tried, middle
        else:
            low = middle
    return new, high, True


def _pressure(problem, y):
    return float(mean_stress(problem.stress(y)))


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
