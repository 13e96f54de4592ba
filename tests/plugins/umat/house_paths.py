"""The loading paths of labkit followed by its own integrator, for comparison with programs that call the law.

A program is given the strain of every record; its increments are straight between records, so the records are close
enough for a difference below 1e-6 of the initial pressure.
"""

import dataclasses
import functools

import numpy as np

from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.integrators import Adaptive
from labkit.model.parameters import Model
from labkit.model.state import ModelState, isotropic_state

PRESSURE = 0.5e6
TOLERANCE = 1e-8  # tolerance of a substep of the law
PATHS = {  # name -> (strain between records, parameters)
    "cv": (1e-4, {"strain": 0.1}),
    "cr": (1e-4, {"strain": 0.1}),
    "cp": (1e-4, {"strain": 0.1}),
    "isoc": (2e-5, {"stop_pressure": 0.6e6}),
    "isod": (2e-5, {"stop_pressure": 0.3e6}),
    "cyclic_cp": (5e-5, {"reversals": (0.01, -0.01, 0.02)}),
    "c1": (2e-5, {"strain": 0.01}),
    "true_triaxial": (5e-5, {"strain": 0.01}),
    "plane_strain": (5e-5, {"strain": 0.01}),
    "oedometer": (5e-5, {"strain": 0.005}),
    "simple_shear": (1e-4, {"strain": 0.1}),
    "simple_shear_cv": (1e-4, {"strain": 0.1}),
    "stress_rotation": (1e-4, {"strain": 0.02, "rotation": 10.0}),
    "proportional": (1e-4, {"strain": 0.02, "ratios": (-0.2, -0.4, 1.0)}),
    "isotropic_reloading": (1e-4, {}),
    "oedometer_reloading": (1e-4, {}),
    "undrained_cycles": (1e-4, {"cycles": 5}),
    "drained_cycles": (1e-4, {"cycles": 3}),
    "strain_cycles": (2e-5, {"strain_amplitude": 0.002, "cycles": 2}),
    "shear_cycles": (5e-5, {"cycles": 2}),
}


@dataclasses.dataclass(frozen=True)
class Curve:
    """A path of the model: the initial state, then strain and stress (n, 3, 3) of the records, compression positive."""

    state: ModelState
    strain: np.ndarray
    stress: np.ndarray


@functools.cache
def curve(name):
    """The path with this name from e = 0.67 and PRESSURE, with a tolerance of 1e-11."""
    record_strain, options = PATHS[name]
    model, options = Model(), dict(options)
    state = isotropic_state(model, 0.67, PRESSURE)
    path = model_path(name, PRESSURE, options.pop("stop_pressure", None), **options)
    result = drive(model, path, state, record_strain, Adaptive(1e-11)).require()
    assert len(result) > 10
    return Curve(state, result.strain, result.stress)


def assert_same_curve(found, expected):
    """`found` and `expected` are stresses (n, 6) with the same order of components."""
    np.testing.assert_allclose(found / PRESSURE, expected / PRESSURE, rtol=0, atol=1e-6)
