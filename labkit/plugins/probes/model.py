"""Probes of the constitutive model: the same increments and loading paths as in labkit.probe."""

from __future__ import annotations

import numpy as np

from labkit.micro.stress import mean_stress
from labkit.micro.tensors import to_six
from labkit.model.driver import drive
from labkit.model.parameters import TABLE_2, Model
from labkit.model.state import ModelState
from labkit.paths.path import Path
from labkit.paths.probes import LOADING, StrainProbe, StressProbe
from labkit.plugins.probes.probe_set import Probes, dataset_of
from labkit.plugins.probes.probing import Probing, plane_of

RECORDS = 3  # records of a probe: two while the increment is applied, one at rest
TYPICAL = 1e-3  # typical strain of a stress change equal to the mean stress; only sets the length of the path


def probe_model(state: ModelState, model: Model = TABLE_2, probing: Probing | None = None) -> Probes:
    """Apply small increments of strain or stress to a state of the model, each to the same state; returns Probes.

    `labkit.model.state_of(snapshot)` returns the model state with the statistics of the grains in a snapshot. Raises
    InputError for invalid settings, and PhysicsError if a probe fails.

    Args:
        state: State of the model.
        model: The model.
        probing: Directions, size and duration of the increments (default: those of Probing).
    """
    probing = probing or Probing()
    plane = plane_of(probing.plane)
    angle, direction = plane.directions(probing.directions)
    rows = [_row(state, model, _path(state, model, probing, six)) for six in direction]
    return Probes(dataset_of(plane, probing, "model", angle, rows))


def _path(state: ModelState, model: Model, probing: Probing, direction: np.ndarray) -> Path:
    """Return the path of a probe in a direction, a unit tensor (6,)."""
    size = probing.size(elastic=False)
    if probing.kind == "strain":
        return StrainProbe(increment=size * direction, strain=size / LOADING)
    stress = state.stress(model)
    pressure = float(mean_stress(stress))
    start = to_six(stress) / pressure
    strain = size * TYPICAL / LOADING
    return StressProbe(pressure=pressure, start_stress=start, increment=size * direction, strain=strain)


def _row(state: ModelState, model: Model, path: Path) -> dict[str, object]:
    """Return the variables of one probe."""
    result = drive(model, path, state, record_strain=path.strain / RECORDS).require()
    return {
        "start_stress": result.stress[0],
        "strain_increment": result.strain[-1],
        "stress_increment": result.stress[-1] - result.stress[0],
    }
