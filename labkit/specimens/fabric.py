"""A shear that leaves a fabric: by 5 % at constant mean stress in triaxial compression or extension, and back.

Contacts form in the direction of compression and open across it; most of this anisotropy A remains when the stress is
isotropic again. Its sign decides whether a specimen of the same void ratio keeps or loses its mean stress when it is
sheared at constant volume.
"""

from __future__ import annotations

import math
from collections.abc import Generator

from labkit.engines.base import Load, Request
from labkit.engines.device import Device
from labkit.errors import PhysicsError
from labkit.grains.state import State
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import deviatoric_stress
from labkit.paths.rates import on_grains, rate_of
from labkit.paths.standard import Consolidation, ConstantMeanStress
from labkit.paths.step import Here
from labkit.records.energy import open_ledger, require_balanced
from labkit.specimens.consolidation import advance_along
from labkit.specimens.ready import Answer, ready

SIGNS = {"pre-compressed": 1, "pre-extended": -1}  # fabric of a recipe -> sign of the axial strain
STRAIN = 0.05  # axial strain of the shear
CHECK = 50  # time steps between two examinations of the stress


def shear_and_return(specimen: State, sign: int, at: Consolidation, device: Device) -> State:
    """Return a specimen at rest at q = 0, after a shear of 5 % at constant mean stress.

    The shear stresses and differences of the normal stresses that remain are left to a consolidation. Raises
    PhysicsError if q does not return to zero within the same strain.

    Args:
        specimen: State at rest at isotropic stress.
        sign: 1 for compression along z, -1 for extension.
        at: Consolidation that has led to this stress.
        device: Creates the engine.
    """
    return device.drive(_requests(specimen, sign, at.held_pressure))


def _requests(specimen: State, sign: int, pressure: float) -> Generator[Request, Answer, State]:
    """Yield the requests of `shear_and_return` to an engine."""
    state = open_ledger((yield from ready(specimen.at_rest())))
    abilities = yield Load(state)
    for direction in (sign, -sign):
        path = on_grains(ConstantMeanStress(pressure=pressure, strain=direction * STRAIN), state.scene)
        step, rate = next(iter(path.steps_from(Here()))), rate_of(path)
        for _ in range(math.ceil(STRAIN / (rate * CHECK * state.time_step))):
            snapshot = state.snapshot()
            require_balanced(state, snapshot)
            if direction != sign and sign * deviatoric_stress(love_stress(snapshot)) <= 0.0:
                return state.at_rest()
            yield from advance_along(step, rate, state, snapshot, CHECK, abilities.follow is not None)
            state = yield lambda engine: engine.state()
    raise PhysicsError("the deviatoric stress did not return to zero after the shear of 5 %: choose a denser specimen")
