"""Contacts that act across a gap, on engines: forces, energies, beams, restarts, tests of a specimen."""

import math

import numpy as np
import pytest

import labkit as lk
from labkit.engines.base import reload
from labkit.engines.fused import FusedEngine
from labkit.engines.yade import YadeEngine
from labkit.errors import InputError
from labkit.grains.columns import history_fields
from labkit.grains.laws import LAWS
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.grains.state_file import read_state, write_state
from labkit.micro.snapshot import love_stress
from labkit.records.energy import balance_error, open_ledger
from tests.engines.two_heavy_grains import NEARLY_NONE
from tests.killed import run_killed

pytestmark = pytest.mark.slow

R = 8.5e-5
STILL = np.zeros((3, 3))
REACHING = [name for name in LAWS if LAWS[name]().far]


def grains(scene, position, length=None, cell=40 * R):
    """Equal grains at positions in radii; consecutive ones are in contact, joined or bonded with a `length`."""
    position = R * np.asarray(position, dtype=float)
    state = grains_in_cell(scene, np.full(len(position), R), position, cell * np.eye(3))
    if length is None:
        return state
    pairs = np.column_stack([np.arange(len(position) - 1), np.arange(1, len(position))]).astype(np.int32)
    known = {"joined": np.ones(len(pairs)), "bond_length": length * np.ones(len(pairs))}
    known = {name: values for name, values in known.items() if name in scene.contact_law.columns}
    return state.replace(
        contact_grain=pairs,
        contact_shift=np.zeros((len(pairs), 3), np.int32),
        **history_fields(scene.contact_law.columns, known, len(pairs)),
    )


@pytest.mark.parametrize(
    "law, precision", [*((law, "double") for law in REACHING), ("jkr", "mixed"), ("bonded", "mixed")]
)
def test_stress_and_forces_of_pairs_with_and_without_a_gap(law, precision):
    """Love's stress of the engine is that of the contacts of its state; a pair at a distance pulls if it is joined."""
    scene = Scene(law=law)
    for gap in (-1e-3, 3e-4):
        state = grains(scene, [(10, 10, 10), (12 + gap, 10, 10)], length=2.0 * R)
        engine = FusedEngine(state, precision=precision)
        after = engine.state()
        contacts, stress = after.snapshot().contacts, love_stress(after.snapshot())
        joined = gap < 0.0 or law != "dmt"
        assert len(contacts) == joined
        scale = np.abs(stress).max() or 1.0
        np.testing.assert_allclose(
            engine.stress() / scale, stress / scale, atol=1e-12 if precision == "double" else 2e-3
        )
        if gap > 0.0 and joined:
            assert contacts.normal_force[0] < 0.0 and contacts.overlap[0] < 0.0 and stress[0, 0] < 0.0
    apart = FusedEngine(grains(scene, [(10, 10, 10), (12.0003, 10, 10)])).state()
    assert len(apart.contact_grain) == 0  # the grains have never touched


@pytest.mark.parametrize("law", REACHING)
def test_energy_over_1e5_steps(law):
    """Twelve grains that stick, bounce, part and join again in a cube, without damping."""
    scene = Scene(law=law, local_damping=NEARLY_NONE, time_step_factor=0.02, friction=0.3)
    grid = np.stack(np.meshgrid(*[np.arange(2)] * 2, np.arange(3), indexing="ij"), axis=-1).reshape(-1, 3)
    state = grains(scene, 5.0 + 1.999 * grid, cell=10 * R)
    rng = np.random.default_rng(1)
    state = state.replace(
        velocity=2e-3 * rng.normal(size=(12, 3)),
        angular_velocity=10.0 * rng.normal(size=(12, 3)),
        time_step=scene.time_step,
    )
    engine = FusedEngine(state)
    state = engine.state()
    if law == "bonded":
        engine.load(state := lk.bond(state, scene))
    engine.load(open_ledger(state))
    engine.advance(100_000, STILL)
    end = engine.state()
    assert abs(balance_error(end)) < 0.03  # friction is counted to first order in the time step
    assert end.columns["bond_length" if law == "bonded" else "joined"].any()


@pytest.mark.parametrize(
    "law, speed, largest",
    [("dmt", -0.05, 3e-4), ("jkr", -0.1, 8e-4), ("bonded", 2.0, 2e-3)],
    ids=lambda value: str(value),
)
def test_joining_parting_and_breaking_keep_the_energy_to_more_than_first_order(law, speed, largest):
    """Two grains meet and part, or a bond breaks, at any instant of a time step; no force acts before and after."""
    errors = {}
    for factor in (0.1, 0.05):
        scene = Scene(law=law, local_damping=NEARLY_NONE, time_step_factor=factor)
        scene = scene.replace(bond_strength=2e5, bond_shear_strength=2e5) if law == "bonded" else scene
        errors[factor] = []
        for start in np.linspace(0.0, 1e-3, 5):
            apart = 2.0 + start + (1e-4 if speed < 0.0 else 0.0)
            state = grains(scene, [(10, 10, 10), (10 + apart, 10, 10)], None if speed < 0.0 else apart * R)
            moving = state.replace(velocity=np.array([[0, 0, 0], [speed, 0, 0]]), time_step=scene.time_step)
            engine = FusedEngine(moving)
            engine.load(open_ledger(engine.state()))
            engine.advance(int(6e-2 * R / abs(speed) / scene.time_step), STILL)
            end = engine.state()
            assert not len(end.contact_grain)
            errors[factor].append(balance_error(end))
    coarse, fine = (np.sqrt(np.mean(np.square(values))) for values in errors.values())
    assert coarse < largest and fine < coarse / 1.5


def frequency(state, amplitude, expected):
    """Angular frequency of the mode of a bar, rad/s, from 40 values of its amplitude in two periods."""
    engine, every = FusedEngine(state), max(1, round(4.0 * math.pi / expected / 40 / state.time_step))
    values = [0.0]
    for _ in range(40):
        engine.advance(every, STILL)
        values.append(amplitude(engine.state()))
    a = np.array(values)
    cosine = ((a[2:] + a[:-2]) @ a[1:-1]) / (2.0 * a[1:-1] @ a[1:-1])
    assert len(engine.state().contact_grain) == len(state.radius)
    return math.acos(cosine) / (every * state.time_step)


@pytest.mark.parametrize("mode", ["axial", "torsion", "bending"])
def test_a_bonded_bar_vibrates_like_a_beam(mode):
    """A periodic row of 48 grains in the mode of its length, of soft grains, against bar and Euler-Bernoulli theory."""
    number = 48
    none = dict.fromkeys(("friction", "rolling_friction", "local_damping"), NEARLY_NONE)
    scene = Scene(law="bonded", young_modulus="1 Pa", **none)
    x = 2.0 * np.arange(number) + 1.0
    row = grains(scene, np.column_stack([x, 0 * x + 5, 0 * x + 5]), length=2.0 * R)
    cell = np.diag([2.0 * number, 10.0, 10.0]) * R
    last = {"contact_grain": [[0, number - 1]], "contact_shift": [[-1, 0, 0]]}
    values = {name: np.concatenate([getattr(row, name), np.array(v, np.int32)]) for name, v in last.items()}
    history = history_fields(scene.contact_law.columns, {"bond_length": np.full(number, 2.0 * R)}, number)
    row = row.replace(cell=cell, **history, **values)
    k = 2.0 * math.pi / cell[0, 0]
    shape, slope = np.sin(k * R * x), k * np.cos(k * R * x)
    area, E = math.pi * R**2, scene.bond_modulus
    mass, inertia = scene.mass(R) / (2 * R), scene.moment_of_inertia(R) / (2 * R)  # per length
    v = 1e-6 * k * R
    if mode == "torsion":
        expected = k * math.sqrt(E / scene.stiffness_ratio * area * R**2 / 2.0 / inertia)
        row = row.replace(angular_velocity=np.column_stack([v / R * shape, 0 * x, 0 * x]))
        row = row.replace(time_step=scene.time_step)
        amplitude = lambda state: np.cos(k * R * (x + 1.0)) @ torque(state)  # noqa: E731
    elif mode == "axial":
        expected = k * math.sqrt(E * area / mass)
        row = row.replace(velocity=np.column_stack([v * shape, 0 * x, 0 * x]), time_step=scene.time_step)
        amplitude = lambda state: shape @ (state.position[:, 0] - row.position[:, 0])  # noqa: E731
    else:
        expected = k**2 * math.sqrt(E * area * R**2 / 4.0 / mass)
        spin = np.column_stack([0 * x, -v * slope, 0 * x])  # dw/dx is a rotation about -y
        row = row.replace(velocity=np.column_stack([0 * x, 0 * x, v * shape]), angular_velocity=spin)
        row = row.replace(time_step=scene.time_step)
        amplitude = lambda state: shape @ (state.position[:, 2] - row.position[:, 2])  # noqa: E731
    assert frequency(row, amplitude, expected) == pytest.approx(expected, rel=5e-3)


def torque(state):
    """Torque of the bond after each grain of a row, N m."""
    first = state.contact_grain[:, 0]
    along = state.snapshot().contacts.normal[:, 0]
    values = np.zeros(len(state.radius))
    wrap = state.contact_shift[:, 0] != 0
    values[np.where(wrap, len(values) - 1, first)] = state.columns["bond_moment"][:, 0] * along
    return values


def test_bonds_of_a_stretched_row_break_at_their_strength():
    scene = Scene(law="bonded", local_damping=0.9)
    strain = scene.bond_strength / scene.bond_modulus
    position = [(10, 10, 10), (12 + 2 * strain * (1 - 1e-6), 10, 10), (20, 10, 10)]
    state = grains(scene, position, length=np.array([2 * R, 0.0]))
    engine = FusedEngine(state)
    assert (engine.state().columns["bond_length"] > 0.0).sum() == 1
    engine.load(state.replace(position=state.position + np.array([[0, 0, 0], [4e-6 * strain * R, 0, 0], [0, 0, 0]])))
    end = engine.state()
    stored = 0.5 * scene.bond_strength**2 / scene.bond_modulus * math.pi * R**2 * 2 * R
    assert not len(end.contact_grain) and end.ledger.further["breaking_loss"] == pytest.approx(stored, rel=1e-5)


@pytest.fixture(scope="module", params=REACHING)
def specimen(request):
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=150, seed=4), Scene(law=request.param), progress=False)
    return lk.bond(state, state.scene.replace(bond_strength=2e5)) if request.param == "bonded" else state


def test_a_file_and_a_restart_have_the_same_bits(specimen, tmp_path):
    gradient = np.diag([20.0, 20.0, -40.0])
    engine = FusedEngine(specimen)
    engine.advance(400, gradient)
    state = reload(engine)
    write_state(tmp_path / "s.state.nc", state)
    engine.advance(400, gradient)
    kept = read_state(tmp_path / "s.state.nc")
    assert (
        kept.digest() == state.digest()
        and kept.ledger == state.ledger
        and any(values.any() for values in state.columns.values())
    )
    again = FusedEngine(kept)
    again.advance(400, gradient)
    one, two = engine.state(), again.state()
    assert one.digest() == two.digest() and one.ledger == two.ledger
    if specimen.scene.law in ("jkr", "bonded"):
        mixed = FusedEngine(specimen, precision="mixed")
        mixed.advance(100, gradient)
        assert np.isfinite(mixed.stress()).all()


@pytest.mark.parametrize("specimen", ["bonded"], indirect=True)
def test_a_killed_run_of_bonds_resumes_to_the_same_bits(specimen, tmp_path):
    path, file = lk.paths.ConstantVolume(strain=0.01, rate=100.0), tmp_path / "r.run.nc"
    options = {"record_strain": 0.001, "save_every": 1, "progress": False}
    whole = lk.run(specimen, path, **options)
    assert (whole.data["breaking_loss"].values[-1] > 0.0) and (whole.state.columns["bond_length"] > 0.0).any()
    run_killed(3, specimen, path, file, options)
    assert not lk.open_run(file).attrs["complete"]
    again = lk.run(specimen, path, file=file, **options)
    for name in ("stress", "void_ratio", "breaking_loss"):
        assert np.array_equal(again.data[name].values, whole.data[name].values)
    assert again.state.digest() == whole.state.digest()


@pytest.mark.parametrize(
    "path",
    [
        lk.paths.ConstantVolume(strain=0.004, rate=100.0),
        lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.004, rate=100.0),
        lk.paths.SimpleShear(pressure=0.3e6, strain=0.004, rate=100.0),
    ],
    ids=lambda path: path.name,
)
def test_a_path_with_each_part(specimen, path, tmp_path):
    run = lk.run(specimen, path, file=tmp_path / "r.run.nc", progress=False, record_strain=1e-3)
    assert run.complete
    data = run.data
    assert np.abs(data["energy_balance_error"].values).max() < 0.05
    assert np.isfinite(data["breaking_loss"].values).all()
    snapshot = run.snapshots[-1]
    contacts = snapshot.contacts
    np.testing.assert_allclose(love_stress(snapshot), data["stress"].values[-1], rtol=1e-9, atol=1e-3)
    assert contacts.columns.get("joined", np.zeros(1)).all() == (specimen.scene.law != "bonded")
    assert (contacts.normal_force < 0.0).any() or specimen.scene.law == "bonded"
    assert lk.read_state(tmp_path / "r.run.nc").columns.keys() == specimen.columns.keys()


@pytest.mark.parametrize(
    "law, reason", [("dmt", "in tension"), ("jkr", "no JKR"), ("bonded", "stress criterion"), ("capillary", "tables")]
)
def test_yade_refuses_a_law_that_it_lacks_and_says_why(law, reason):
    with pytest.raises(InputError, match=rf"^engine yade .*\b{law} \(.*{reason}.*\)"):
        YadeEngine.abilities.require_scene(Scene(law=law))


def test_a_scene_with_bonds_needs_a_law_with_bonds():
    with pytest.raises(InputError, match="has no bonds"):
        lk.bond(grains(Scene(), [(1, 1, 1)]), Scene())


@pytest.mark.parametrize("stretch, whole", [(0.0, True), (0.99, True), (1.02, False)])
def test_a_bond_across_a_gap_holds_until_its_strength(stretch, whole):
    scene = Scene(law="bonded")
    length = 2.4 * (1.0 + stretch * scene.bond_strength / scene.bond_modulus)
    state = grains(scene, [(10, 10, 10), (10 + length, 10, 10), (20, 20, 20)], length=np.array([2.4 * R, 0.0]))
    assert FusedEngine(state).state().columns["bond_length"].any() == whole


@pytest.mark.parametrize("specimen", ["bonded"], indirect=True)
def test_bonds_that_never_break_are_refused(specimen):
    strong = lk.bond(specimen, specimen.scene.replace(bond_strength=1e12))
    with pytest.raises(InputError) as refused:
        lk.run(strong, lk.paths.ConstantVolume(strain=0.004, rate=100.0), progress=False)
    assert refused.value.field == "bond_strength" and refused.value.value == 1e12


@pytest.mark.parametrize("specimen", ["capillary"], indirect=True)
def test_all_contacts_of_a_specimen_with_bridges_can_be_bonded(specimen):
    bonded = lk.bond(specimen, Scene(law="bonded"))
    run = lk.run(bonded, lk.paths.ConstantVolume(strain=0.004, rate=100.0), progress=False)
    assert (run.snapshots[0].contacts.overlap < 0.0).any()
    assert len(run.snapshots[0].contacts) == len(bonded.contact_grain)
