"""A user-defined engine: grains follow the deformation of the cell exactly, an upper bound on the stiffness.

labkit run cv s.state.nc --strain 1e-3 --record-strain 1e-4 --engine affine --use examples/own_engine.py
"""

import labkit as lk


@lk.register_engine
class AffineEngine(lk.Engine):
    """All grains move with the mean velocity field; contacts neither form, open, slide nor roll."""

    name, version = "affine", "1"

    def __init__(self, state, threads=1):
        self._state = state.replace(engine=self.name, engine_version=self.version)

    load = __init__

    def advance(self, steps, velocity_gradient):
        for _ in range(steps):
            old, L, dt, stress = self._state, velocity_gradient, self._state.time_step, self.stress()
            contacts, pair = old.snapshot().contacts, old.radius[old.contact_grain].T
            v = contacts.branch_length(old.radius)[:, None] * contacts.normal @ L.T  # second grain, relative to first
            slip = v - (v * contacts.normal).sum(axis=1, keepdims=True) * contacts.normal
            force = old.tangential_force + dt * old.scene.tangential_stiffness(*pair)[:, None] * slip
            x, cell = old.position + dt * old.position @ L.T, old.cell + dt * L @ old.cell
            motion = {"position": x, "velocity": x @ L.T, "cell": cell, "velocity_gradient": L}
            self._state = old.replace(**motion, tangential_force=force, step=old.step + 1, time=old.time + dt)
            work = -0.5 * old.volume * dt * ((stress + self.stress()) * L).sum()
            self._state = self._state.replace(ledger=old.ledger.plus(work, 0.0, 0.0, 0.0))

    def stress(self):
        return lk.love_stress(self._state.snapshot())

    def state(self):
        return self._state

    def stop_grains(self): ...  # relative to the mean velocity field, the grains are at rest
