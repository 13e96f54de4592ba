"""An engine of your own: grains that follow the cell and do not slide, the upper bound of every stiffness.

labkit run cv s.state.nc --strain 1e-3 --record-strain 1e-4 --engine affine --use examples/own_engine.py
"""

import numpy as np

import labkit as lk


@lk.register_engine
class AffineEngine(lk.Engine):
    """All grains move with the mean field; contacts open but do not form, nor do they slide or roll."""

    name, version = "affine", "1"

    def __init__(self, state, threads=1):
        self.load(state)

    def load(self, state):
        self._state = state.replace(engine=self.name, engine_version=self.version)

    def advance(self, steps, velocity_gradient):
        s, dt, stress, L = self._state, steps * self._state.time_step, self.stress(), velocity_gradient
        contacts, pair = s.snapshot().contacts, s.radius[s.contact_grain].T
        v = contacts.branch_length(s.radius)[:, None] * contacts.normal @ L.T  # of the second grain
        slip = v - np.einsum("ci,ci->c", v, contacts.normal)[:, None] * contacts.normal
        force = s.tangential_force + dt * s.scene.tangential_stiffness(*pair)[:, None] * slip
        F = np.linalg.matrix_power(np.eye(3) + s.time_step * L, steps)
        x, now = s.position @ F.T, {"step": s.step + steps, "time": s.time + dt, "velocity_gradient": L}
        moved = s.replace(position=x, velocity=x @ L.T, cell=F @ s.cell, tangential_force=force, **now)
        kept = moved.snapshot().contacts.overlap >= 0.0
        names = ("contact_grain", "contact_shift", "tangential_force", "rolling_moment")
        self._state = moved = moved.replace(**{name: getattr(moved, name)[kept] for name in names})
        work = -0.5 * s.volume * dt * np.sum((stress + self.stress()) * L)
        self._state = moved.replace(ledger=s.ledger.plus(work, 0.0, 0.0, 0.0))

    def stress(self):
        return lk.love_stress(self._state.snapshot())

    def state(self):
        return self._state

    def stop_grains(self):
        return None
