"""Run by test_lammps on several ranks: prints how far summed records are from those of the gathered State."""

import sys

import numpy as np
from mpi4py import MPI

import labkit as lk
from labkit.dem.measure import measure
from labkit.dem.servo import cell_stiffness
from labkit.engines.lammps.engine import LammpsEngine, dismiss, domain_of, follow

KEPT = ("friction_loss", "rolling_loss", "damping_loss", "energy_balance_error")  # unknown
STEPS, STRETCH = 200, np.diag([5.0, 5.0, -10.0])


def main(file):
    comm = MPI.COMM_WORLD
    domain_of(comm)
    if comm.rank:
        return follow(comm)
    state = lk.read_state(file)
    engine = LammpsEngine(state, comm.size)
    engine.advance(STEPS, STRETCH)
    instant, whole = engine.instant(), engine.state()
    record, expected = instant.measure(state.cell), measure(whole, state.cell)
    scale = {"drift_velocity": np.sqrt(2.0 * expected["kinetic_energy"] / whole.scene.mass(whole.radius).sum())}
    scale["unbalanced_force"] = 1.0  # of the mean contact force
    for name in (name for name in expected if name not in KEPT):
        difference = np.abs(np.asarray(record[name]) - expected[name]).max()
        print(name, difference / max(scale.get(name, np.abs(expected[name]).max()), 1e-300))
    stiffness = cell_stiffness(whole.snapshot(), 6)
    print("stiffness", np.abs(instant.stiffness(6) - stiffness).max() / stiffness.max())
    again = engine.reload()
    print("reload", np.abs(lk.love_stress(again.snapshot()) - lk.love_stress(whole.snapshot())).max() / 1e6)
    dismiss(comm)


if __name__ == "__main__":
    main(sys.argv[1])
