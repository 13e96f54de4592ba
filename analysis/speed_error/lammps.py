"""The CV test in LAMMPS and with the `spring_dashpot` law of the `fused` engine.

`benchmarks/lammps.py` lists the differences between the two models. Measured with 996 grains, e = 0.67, beta = 0.2,
from the same specimen:

* after settling, the pressure is 2.1 % below that of the specimen; on the `fused` engine with the tangential forces
  reset to zero, it is 1.9 % below;
* in CV at 20 1/s, q/p is 1.1 % low at 1 and 2 % strain, and 1 to 0.1 % low from 3 to 7 %; beyond that, LAMMPS
  and `fused` differ by as much as two specimens do. The means from 10 to 20 % are q/p = 0.977 (fused 0.971) and
  p = 1.324 MPa (fused 1.316 without the initial tangential forces, 1.388 with them);
* six specimens of 500 grains at 100 1/s: LAMMPS relative to `fused`, with the tangential forces reset and the specimen
  settled there too (mean and standard error, %):

      beta_n, beta_t   q/p at 1 %      at 5 %          from 10 to 20 %   p from 10 to 20 %
      0.2,  0.2        -1.25 +- 0.23   -1.20 +- 0.15   -1.8 +- 0.9       -4.2 +- 1.5
      0.02, 0.02       -0.22 +- 0.04   -0.50 +- 0.25    0.6 +- 0.3        0.7 +- 0.7
      0.2,  0           0.00 +- 0.07   -0.22 +- 0.15   -0.2 +- 0.6       -0.9 +- 1.5

  The 1.2 % is therefore due to the tangential dashpot, to which only LAMMPS applies the friction limit. The difference
  persists at 20 1/s; half of it arises during settling, which depends on the dashpot.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from benchmarks.lammps import LammpsRun, deform
from labkit.errors import InputError
from labkit.grains import State
from labkit.paths import ConstantVolume

CLASSES = 8  # of grain size: pair stiffnesses are accurate to 3 %, 0.9 % on average (24 % and 7 % with one class)
SETTLE = 5000  # steps at rest, in which tangential forces develop: LAMMPS starts without them


@dataclasses.dataclass(frozen=True)
class LammpsShear(LammpsRun):
    """A CV test in LAMMPS with this time step, s. Record 0 is the settled specimen at zero strain."""

    time_step: float

    @property
    def axial_strain(self) -> np.ndarray:
        """Logarithmic axial strain, compression positive, (record,)."""
        return -np.log(self.size[:, 2] / self.size[0, 2])

    @property
    def volume(self) -> np.ndarray:
        """Volume of the cell, (record,), m3."""
        return self.size.prod(axis=1)


def shear_in_lammps(
    program: str, state: State, rate: float, strain: float, records: int, settle: int = SETTLE, classes: int = CLASSES
) -> LammpsShear:
    """Shears the specimen `state` at constant volume at the axial `rate` (1/s) to the logarithmic axial `strain`.

    `program`: the executable of LAMMPS. The time step equals that of the state or is slightly smaller, so that the
    records divide the strain evenly. `fix deform trate` makes L = L0 exp(rate t): these are the logarithmic strains
    of labkit, and the volume stays constant to rounding.

    Tangential and rolling contact forces are not transferred: the specimen first settles for `settle` steps in its
    cell. Its pressure is then stress[0], not that of the state.

    Raises InputError for an impossible path, PhysicsError if LAMMPS fails.
    """
    if records < 1:
        raise InputError(f"cannot write {records} records: use 1 or more")
    path = ConstantVolume(rate, strain)
    every = math.ceil(strain / (rate * state.time_step * records))
    steps = every * records
    state = state.replace(time_step=strain / (rate * steps))
    run = deform(program, state, -rate * np.array(path.direction), steps, settle, every, classes)
    return LammpsShear(**vars(run), time_step=state.time_step)
