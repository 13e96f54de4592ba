"""The CV path in LAMMPS beside law spring_dashpot: labkit/bench/lammps.py says what is alike and what is not.

Measured with 996 grains, e = 0.67, beta = 0.2, against the engine fused from the same specimen:

* settled, the pressure is 2.1 % below that of the specimen; on the engine fused, when it forgets the tangential
  forces, 1.9 %;
* CV at 20 1/s: q/p is 1.1 % low at 1 and 2 % of strain, 1 to 0.1 % from 3 to 7 %; from there on the two drift apart
  as two specimens do. The means from 10 to 20 % are q/p = 0.977 (fused 0.971) and p = 1.324 MPa (fused 1.316
  without the tangential forces at the start, 1.388 with them);
* six specimens of 500 grains at 100 1/s, LAMMPS over fused, which forgets and settles too (mean and standard error, %):

      beta_n, beta_t   q/p at 1 %      at 5 %          from 10 to 20 %   p from 10 to 20 %
      0.2,  0.2        -1.25 +- 0.23   -1.20 +- 0.15   -1.8 +- 0.9       -4.2 +- 1.5
      0.02, 0.02       -0.22 +- 0.04   -0.50 +- 0.25    0.6 +- 0.3        0.7 +- 0.7
      0.2,  0           0.00 +- 0.07   -0.22 +- 0.15   -0.2 +- 0.6       -0.9 +- 1.5

  so the 1.2 % is that of the tangential dashpot, which the limit of friction bounds in LAMMPS alone. It stays at
  20 1/s; half of it comes with the settling, which is another one with another dashpot.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from labkit.bench import deform
from labkit.dem import ConstantVolume, State
from labkit.errors import InputError

CLASSES = 8  # of grain size: a stiffness is within 3 % of its pair's, 0.9 % on average; of one class 24 % and 7 %
SETTLE = 5000  # steps at rest: grains find the tangential forces that LAMMPS has not been told


@dataclasses.dataclass(frozen=True)
class LammpsShear:
    """A CV test in LAMMPS. Record 0 is the settled specimen at zero strain.

    axial_strain (record,), logarithmic, compression positive; stress (record, 3, 3) of contact forces and dashpots,
    Pa, compression positive; volume (record,) of the cell, m3; seconds of the loop over `steps` steps of
    `time_step`, s, without the settling.
    """

    axial_strain: np.ndarray
    stress: np.ndarray
    volume: np.ndarray
    seconds: float
    steps: int
    time_step: float


def shear_in_lammps(
    program: str, state: State, rate: float, strain: float, records: int, settle: int = SETTLE, classes: int = CLASSES
) -> LammpsShear:
    """The specimen `state` along CV at the axial `rate`, 1/s, to the logarithmic axial `strain`; a LammpsShear.

    `program`: the executable of LAMMPS. The time step is that of the state or a little less, so that records divide
    the strain. `fix deform trate` makes L = L0 exp(rate t): these are the logarithmic strains of labkit, and the
    volume stays to rounding.

    Contact forces tangential and rolling are not taken over: the specimen first settles for `settle` steps in its
    cell. Its pressure is then stress[0], not that of the state.

    Raises InputError for a path that is not possible, PhysicsError if LAMMPS fails.
    """
    if records < 1:
        raise InputError(f"{records} records are not possible: give 1 or more")
    path = ConstantVolume(rate, strain)
    every = math.ceil(strain / (rate * state.time_step * records))
    steps = every * records
    state = state.replace(time_step=strain / (rate * steps))
    run = deform(program, state, -rate * np.array(path.direction), steps, settle, every, classes)
    return LammpsShear(
        axial_strain=-np.log(run.size[:, 2] / run.size[0, 2]),
        stress=run.stress,
        volume=run.size.prod(axis=1),
        seconds=run.seconds,
        steps=run.steps,
        time_step=state.time_step,
    )
