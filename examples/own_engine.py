"""An engine of your own: grains that follow the cell without rearranging, the upper bound of every stiffness.

    labkit run cv s.state.nc --strain 1e-3 --record-strain 1e-4 --engine affine --use examples/own_engine.py
"""

import numpy as np

import labkit as lk


@lk.register_engine
class AffineEngine(lk.Engine):
    """All grains move with the mean field; contacts open but do not form, tangential forces stay what they are."""

    name, version = "affine", "1"

    def __init__(self, state, threads=1):
        self.load(state)

    def load(self, state):
        self._state = state.replace(engine=self.name, engine_version=self.version)

    def advance(self, steps, velocity_gradient):
        s, dt, stress = self._state, self._state.time_step, self.stress()
        F = np.linalg.matrix_power(np.eye(3) + dt * velocity_gradient, steps)
        x, times = s.position @ F.T, {"step": s.step + steps, "time": s.time + steps * dt}
        moved = s.replace(position=x, cell=F @ s.cell, velocity=x @ velocity_gradient.T,
                          velocity_gradient=velocity_gradient, **times)  # fmt: skip
        touching = moved.snapshot().contacts.overlap >= 0.0
        kept = ("contact_grain", "contact_shift", "tangential_force", "rolling_moment")
        self._state = moved.replace(**{name: getattr(moved, name)[touching] for name in kept})
        work = -0.5 * s.volume * steps * dt * np.sum((stress + self.stress()) * velocity_gradient)
        self._state = self._state.replace(ledger=s.ledger.plus(work, 0.0, 0.0, 0.0))

    stress = lambda self: lk.love_stress(self._state.snapshot())  # noqa: E731
    state = lambda self: self._state  # noqa: E731
    stop_grains = lambda self: None  # noqa: E731
