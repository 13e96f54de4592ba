"""Rigid clumps on fused: closed forms, conservation, one sphere as a clump, exclusion, work, time step and files."""

import dataclasses

import numpy as np
import pytest

from labkit.bodies.shapes import Rod, Shape, Sphere
from labkit.engines import Device
from labkit.engines.base import reload
from labkit.engines.fused import FusedEngine
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell, state_of_snapshot
from labkit.grains.state_file import read_state
from labkit.grains.time_step import critical_time_step
from labkit.micro.bodies import axis_anisotropy, branch_anisotropy, stress_along_normals
from labkit.micro.fabric import contact_anisotropy, statistics
from labkit.micro.grains import grain_stress
from labkit.micro.indicators import elastic_energy
from labkit.micro.networks import network_stress
from labkit.micro.snapshot import love_stress
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.paths.standard import ConstantMeanStress, ConstantVolume
from labkit.plugins.campaigns.collection import open_campaign
from labkit.plugins.pictures.picture import grain_colors
from labkit.records.energy import balance_error, kinetic_energy, open_ledger
from labkit.results.dataset import open_run
from labkit.servo.correction import cell_stiffness
from labkit.servo.plan import prescribed_gradient
from labkit.sff.c0 import sff_stress
from labkit.simulation.api import run
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import prepare_specimen
from tests.bodies.clumped import clumped
from tests.engines.two_heavy_grains import NEARLY_NONE

pytestmark = pytest.mark.slow

R = 85e-6
STILL = np.zeros((3, 3))
FUSED = Device("fused")
FREE = Scene(friction=0.5, rolling_friction=0.0, local_damping=NEARLY_NONE)


class Lump(Shape):
    name = "lump"
    centers = ((0, 0, 0), (1.0, 0, 0), (0.3, 0.8, 0.2))
    radii = (1, 0.7, 0.6)


def bodies(scene, positions, shape, seed=3, **motion):
    """Clumps at the positions; motion: body_velocity, or `spin` from which the angular momentum follows."""
    grains = len(positions)
    state = grains_in_cell(scene, np.full(grains, R), np.array(positions, dtype=float), np.eye(3) * 4e-3)
    state = clumped(state, [shape], seed)
    clumps = state.clumps
    spin = np.array(motion.pop("spin", np.zeros((grains, 3))), dtype=float)
    axes, inertia = clumps.axes(), scene.density * clumps.body_inertia
    momentum = np.einsum("bij,bj,bkj,bk->bi", axes, inertia, axes, spin)
    clumps = dataclasses.replace(clumps, angular_momentum=momentum, **motion)
    arm = state.position - clumps.body_position[clumps.body]
    velocity = clumps.body_velocity[clumps.body] + np.cross(spin[clumps.body], arm)
    return state.replace(clumps=clumps, velocity=velocity, angular_velocity=spin[clumps.body])


def momenta(state):
    """Momentum and angular momentum about the middle of the cell."""
    clumps, density = state.clumps, state.scene.density
    linear = density * clumps.body_volume[:, None] * clumps.body_velocity
    arm = clumps.body_position - 2e-3
    return linear.sum(axis=0), (clumps.angular_momentum + np.cross(arm, linear)).sum(axis=0)


def test_an_asymmetric_clump_rotates_freely_without_drift():
    state = bodies(FREE, [[2e-3] * 3], Lump(), spin=[[300.0, 900.0, 500.0]]).replace(time_step=1e-6)
    engine, energies = FusedEngine(state), []
    for _ in range(20):
        engine.advance(5000, STILL)  # 1e5 steps: 16 turns
        energies.append(kinetic_energy(engine.state()))
    end = engine.state().clumps
    assert np.array_equal(end.angular_momentum, state.clumps.angular_momentum)
    assert np.abs(np.array(energies) / energies[0] - 1.0).max() < 1e-7  # oscillates with dt^2, without drift
    assert np.linalg.norm(end.orientation) == pytest.approx(1.0, abs=1e-15)


def test_a_symmetric_top_precesses_as_the_closed_form():
    spin = np.array([900.0, 300.0, 0.0])  # in the principal axes
    errors = []
    for dt in (1e-5, 5e-6):
        state = bodies(FREE, [[2e-3] * 3], Rod(2.0, 2)).replace(time_step=dt)
        axes, inertia = state.clumps.axes()[0], FREE.density * state.clumps.body_inertia[0]
        momentum = axes @ (inertia * spin)
        clumps = dataclasses.replace(state.clumps, angular_momentum=momentum[None])
        engine = FusedEngine(state.replace(clumps=clumps, angular_velocity=np.tile(axes @ spin, (2, 1))))
        steps = round(0.02 / dt)
        engine.advance(steps, STILL)
        angle = np.linalg.norm(momentum) / inertia[1] * steps * dt  # the axis turns about the momentum
        k = momentum / np.linalg.norm(momentum)
        axis = axes[:, 0]
        turned = axis * np.cos(angle) + np.cross(k, axis) * np.sin(angle) + k * (k @ axis) * (1 - np.cos(angle))
        errors.append(np.linalg.norm(engine.state().clumps.axes()[0][:, 0] - turned))
    assert errors[0] < 2e-2
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)  # second order


def test_force_and_moment_of_one_contact_are_those_of_the_closed_form():
    """A rod lies across the end of another one: one contact, off the centre of the first."""
    state = bodies(FREE, [[1e-3, 2e-3, 2e-3], [1e-3, 2e-3, 2e-3]], Rod(2.0, 2))
    clumps, arm = state.clumps, state.clumps.arm[1, 0]
    half = np.sqrt(0.5)
    radius = state.radius[0]
    overlap = 1e-3 * radius
    position = np.array([[2e-3] * 3, [2e-3 + arm, 2e-3 + 2 * radius - overlap + arm, 2e-3]])
    orientation = np.array([[1.0, 0, 0, 0], [half, 0, 0, half]])  # along x, and along y
    x = np.array([[-arm, 0, 0], [arm, 0, 0], [0, -arm, 0], [0, arm, 0]]) + position[clumps.body]
    state = state.replace(
        position=x, clumps=dataclasses.replace(clumps, body_position=position, orientation=orientation), time_step=1e-9
    )
    engine = FusedEngine(state)
    now = engine.state()
    assert now.contact_grain.tolist() == [[1, 2]]
    force = FREE.normal_stiffness(radius, radius) * overlap
    expected = np.zeros((3, 3))
    expected[0, 1], expected[1, 1] = arm, 2 * radius - overlap + arm  # the branch of the centres, along which f acts
    assert engine.stress() * 64e-9 == pytest.approx(force * expected, rel=1e-9, abs=1e-9 * force * radius)
    assert love_stress(now.snapshot()) == pytest.approx(engine.stress(), rel=1e-9, abs=1e-12)
    engine.advance(1, STILL)
    moved, dt = engine.state().clumps, 1e-9
    mass = FREE.density * clumps.body_volume[0]
    assert moved.body_velocity[0] == pytest.approx([0, -force / mass * dt, 0], rel=1e-9, abs=1e-20)
    assert moved.angular_momentum[0] == pytest.approx([0, 0, -force * arm * dt], rel=1e-9, abs=1e-30)
    assert moved.angular_momentum[1] == pytest.approx(0.0, abs=1e-9 * force * arm * dt)


def test_a_collision_conserves_momentum_angular_momentum_and_energy():
    """Without friction and damping; the energy converges with the square of the time step."""
    scene, drifts = FREE.replace(friction=NEARLY_NONE), []
    for dt in (2e-8, 1e-8):
        positions, velocity = [[2e-3] * 3, [2.32e-3, 2.05e-3, 2.04e-3]], np.array([[0.2, 0, 0], [-0.2, 0, 0]])
        state = bodies(scene, positions, Lump(), 4, body_velocity=velocity).replace(time_step=dt)
        engine = FusedEngine(open_ledger(state))
        engine.advance(round(8e-4 / dt), STILL)
        end = engine.state()
        assert not len(end.contact_grain)
        for before, after in zip(momenta(state), momenta(end), strict=True):
            assert after == pytest.approx(before, rel=1e-9, abs=1e-9 * np.abs(before).max())
        drifts.append(abs(kinetic_energy(end) / kinetic_energy(state) - 1.0))
        assert np.abs(end.clumps.angular_momentum).max() > 1e-15  # the collision was off centre
    assert drifts[0] < 1e-4 and drifts[1] < 0.5 * drifts[0] + 1e-9


@pytest.fixture(scope="module")
def rods():
    """About 250 rods at rest."""
    recipe = Recipe(0.48, 0.15, 0.0, grains=250, shape="rod aspect_ratio=1.5")
    return prepare_specimen(Scene(friction=0.5, rolling_friction=0.0), recipe, FUSED)


def test_clumps_of_one_sphere_are_spheres_to_the_bit(tmp_path):
    scene, recipe = Scene(), Recipe(0.67, grains=150)
    of_spheres = prepare_specimen(scene, recipe, FUSED)
    one = clumped(of_spheres.replace(contact_grain=of_spheres.contact_grain[:0]), [Sphere()])
    of_clumps = of_spheres.replace(clumps=one.clumps)
    path = ConstantMeanStress(pressure=2e5, strain=0.002, rate=20.0)
    runs = [run(state, path, progress=False).data for state in (of_spheres, of_clumps)]
    for name in ("stress", "void_ratio", "contact_anisotropy", "friction_loss", "kinetic_energy", "cell"):
        assert np.array_equal(*(one[name].values for one in runs)), name
    in_file = run(of_clumps, path, file=tmp_path / "r.run.nc", progress=False).data
    assert in_file.attrs["data_sha256"] == runs[1].attrs["data_sha256"]
    mixed = clumped(of_spheres, [Sphere(), Sphere()], 1).clumps
    assert mixed.single.all()


def test_members_of_a_clump_do_not_touch_each_other(rods):
    clumps, pair = rods.clumps, rods.contact_grain
    same = clumps.body[pair[:, 0]] == clumps.body[pair[:, 1]]
    assert not (same & (rods.contact_shift == 0).all(axis=1)).any()
    assert len(pair) > 2 * len(clumps.body_volume)
    assert void_ratio_nominal(rods.snapshot()) == pytest.approx(0.48)


def test_the_energy_is_balanced_and_a_run_survives_reloading_to_the_bit(rods):
    gradient = prescribed_gradient(ConstantVolume(20.0), rods.time_step)
    engine = FusedEngine(open_ledger(rods))
    engine.advance(1500, gradient)
    other = FusedEngine(reload(engine))
    for each in (engine, other):
        each.advance(1500, gradient)
    state = engine.state()
    assert abs(balance_error(state)) < 2e-3
    assert love_stress(state.snapshot()) == pytest.approx(engine.stress(), rel=1e-9, abs=1.0)
    for name, values in other.state().arrays.items():
        assert np.array_equal(values, state.arrays[name]), name
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("labkit.engines.kernel.packing.GRAINS_PER_DOMAIN", 100)  # several domains
        engine = FusedEngine(open_ledger(rods))
        engine.advance(300, gradient)
        parts = engine.state()
    engine = FusedEngine(open_ledger(rods))
    engine.advance(300, gradient)
    whole = engine.state()
    assert parts.position == pytest.approx(whole.position, abs=1e-6 * R)
    assert parts.ledger.cell_work == pytest.approx(whole.ledger.cell_work, rel=1e-6)


def test_mixed_precision_differs_by_its_rounding(rods):
    gradient, stresses = prescribed_gradient(ConstantVolume(20.0), rods.time_step), []
    for precision in ("double", "mixed"):
        engine = FusedEngine(open_ledger(rods), precision=precision)
        engine.advance(100, gradient)
        stresses.append(engine.stress())
        assert love_stress(engine.state().snapshot()) == pytest.approx(stresses[-1], abs=1e-3 * stresses[-1][2, 2])
    assert stresses[1] == pytest.approx(stresses[0], abs=1e-3 * stresses[0][2, 2])


def test_statistics_are_those_of_the_bodies(rods):
    at = rods.snapshot()
    assert at.number_of_grains == len(rods.clumps.body_volume) < rods.number_of_grains
    stress = love_stress(at)
    volume = 4 / 3 * np.pi * at.radius**3
    assert np.einsum("g,gij->ij", volume, grain_stress(at)) / at.volume == pytest.approx(stress, rel=1e-9, abs=1e-6)
    assert network_stress(at, np.ones((len(at.contacts), 2), bool)) == pytest.approx(stress, rel=1e-9, abs=1e-6)
    assert love_stress(at.spheres)[2, 2] < stress[2, 2]  # the branches of the spheres miss the stress inside the clumps
    assert abs(stress_along_normals(at) - stress).max() < 0.2 * stress[2, 2]
    assert abs(stress - stress.T).max() < 0.02 * stress[2, 2]  # moments are balanced
    assert elastic_energy(at) == elastic_energy(at.spheres)
    assert abs(axis_anisotropy(at)).max() < 1.0 and abs(branch_anisotropy(at)).max() < 1.0
    assert branch_anisotropy(at.spheres) == pytest.approx(contact_anisotropy(at.contacts.normal), abs=1e-12)


def test_the_stiffness_is_that_of_a_motion_with_the_mean_field(rods):
    """Against the second derivative of the energy: sum of kn (n.E b)^2 + kt |E b - n (n.E b)|^2."""
    at, strain = rods.snapshot(), np.diag([1.0, -0.3, 0.2])
    contacts, spheres = at.contacts, at.spheres
    kn, kt, *_ = rods.scene.contact_law.tangents(
        rods.scene, *spheres.radius[spheres.contacts.grain].T, spheres.contacts.overlap
    )
    moved = contacts.branch(at.radius) @ strain
    along = np.einsum("ci,ci->c", moved, contacts.normal)
    energy = (kn * along**2 + kt * ((moved**2).sum(axis=1) - along**2)).sum() / at.volume
    e = np.diag(strain)
    floor = 1e-3 * rods.scene.young_modulus
    assert e @ cell_stiffness(at) @ e == pytest.approx(energy + floor * e @ e, rel=1e-9)


def test_the_critical_time_step_of_one_contact_is_that_of_its_mode():
    """Two spheres as clumps of one and, with the same members, the sphere's own limit."""
    position = [[2e-3] * 3, [2e-3 + 1.999 * R, 2e-3, 2e-3]]
    state = grains_in_cell(FREE, np.full(2, R), np.array(position), np.eye(3) * 4e-3)
    touching = FusedEngine(state.replace(time_step=1e-9)).state()
    rods = bodies(FREE, [[2e-3] * 3, [2e-3 + 1.9 * R, 2e-3, 2e-3]], Rod(1.01, 2))
    near = FusedEngine(rods.replace(time_step=1e-9)).state()
    contacts = len(near.contact_grain)
    assert critical_time_step(near) == pytest.approx(critical_time_step(touching) / np.sqrt(contacts), rel=0.1)


def test_a_run_file_keeps_clumps_and_an_interrupted_run_ends_with_the_same_bits(rods, tmp_path):
    path = ConstantMeanStress(pressure=2e5, strain=0.002, rate=20.0)
    whole = run(rods, path, file=tmp_path / "r.run.nc", progress=False)
    at = whole.snapshots[-1]
    assert at.number_of_grains == len(rods.clumps.body_volume)
    assert love_stress(at) == pytest.approx(whole.data["stress"].values[-1], rel=1e-12)
    body = at.clumps.body
    assert np.array_equal(grain_colors(at), grain_colors(at)[at.clumps.first[body]])  # one colour per clump
    with open_run(tmp_path / "r.run.nc") as data:
        assert love_stress(data.lab.snapshot(-1)) == pytest.approx(love_stress(at), rel=1e-12)
        assert data["stress_sff"].values[-1] == pytest.approx(sff_stress(at), rel=1e-9)
        p_by_volume = np.trace(data["stress_sff_by_volume"].values[-1])
        assert p_by_volume == pytest.approx(np.trace(data["stress"].values[-1]), rel=1e-6)
        for name in ("contact_eccentricity", "normal_force_eccentricity", "tangential_force_eccentricity"):
            assert data[name].values[-1] == pytest.approx(getattr(statistics(at), name), rel=1e-9), name
            assert data.lab.statistics()[name].values[-1] == pytest.approx(data[name].values[-1], rel=1e-9)
        share = data.lab.strength_shares().isel(time=-1)
        assert float(share.sum()) == pytest.approx(float(data.lab.stress_ratio("stress_sff")[-1]), rel=1e-9)
    end = read_state(tmp_path / "r.run.nc")
    again = state_of_snapshot(at)
    assert np.array_equal(again.clumps.orientation, end.clumps.orientation)
    assert again.contact_grain.tolist() == end.contact_grain.tolist()
    first = read_state(tmp_path / "r.run.nc", snapshot=0)
    assert first.clumps.body.tolist() == rods.clumps.body.tolist()
    assert open_campaign(tmp_path / "r.run.nc")["grains"].values.tolist() == [at.number_of_grains]


def test_engines_without_clumps_refuse_them_in_one_sentence(rods):
    rods = rods.replace(scene=Scene(law="spring_dashpot"))
    with pytest.raises(InputError, match="lammps does not support clumps: give yade or fused"):
        Device("lammps")(rods)
    with pytest.raises(InputError, match="clumps"):
        run(rods, ConstantVolume(strain=0.001), engine="lammps", progress=False)
