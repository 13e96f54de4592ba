"""States in memory are judged like states in files: impossible grains are refused with a sentence on what to give."""

import dataclasses

import numpy as np
import pytest

import labkit as lk
from labkit.engines import Device
from labkit.grains.state import grains_in_cell
from labkit.specimens.recipe import Recipe
from tests.changed import changed

CONTACTS = ("contact_grain", "contact_shift", "tangential_force", "rolling_moment")


@pytest.fixture(scope="module")
def states(soft_specimen):
    rods = lk.make_specimen(Recipe(void_ratio=0.6, grains=200, shape="rod aspect_ratio=1.5"), progress=False)
    sticky = lk.Scene(law="jkr", young_modulus=5e9)
    joined = lk.make_specimen(Recipe(void_ratio=0.66, grains=200), sticky, progress=False)
    return {"soft": soft_specimen, "bonded": lk.bond(soft_specimen), "jkr": joined, "rods": rods}


def rows(state, kept):
    columns = {name: values[kept] for name, values in state.columns.items()}
    return state.replace(**{name: getattr(state, name)[kept] for name in CONTACTS}, columns=columns)


def put(name, value, index=7):
    """Function of a State that returns a copy with one value of an array changed, also in clumps and columns."""

    def change(state):
        values = state.arrays[name].copy()
        values[index] = value(values[index]) if callable(value) else value
        if name in state.columns:
            return state.replace(columns={**state.columns, name: values})
        if state.clumps is not None and name in state.clumps.table:
            return state.replace(clumps=dataclasses.replace(state.clumps, **{name: values}))
        return state.replace(**{name: values})

    return change


def twice(state, swapped=False):
    """The State with its first three contacts listed again, with the grains exchanged if `swapped`."""
    number = len(state.contact_grain)
    state = rows(state, np.r_[:number, 0:3])
    if not swapped:
        return state
    grain, shift = state.contact_grain.copy(), state.contact_shift.copy()
    grain[number:], shift[number:] = grain[number:, ::-1], -shift[number:]
    return state.replace(contact_grain=grain, contact_shift=shift)


def with_itself(state):
    return put("contact_shift", 0)(put("contact_grain", 3)(state))


def within_a_clump(state):
    return put("contact_shift", 0)(put("contact_grain", [0, 1])(state))


WRONG = {
    "a contact with itself": ("soft", with_itself, "lists a contact of a grain with itself: give two different"),
    "duplicates": ("soft", twice, "lists 3 contacts twice, e.g. of grains .* and .*: give each contact once"),
    "exchanged duplicates": ("soft", lambda s: twice(s, True), "lists 3 contacts twice"),
    "an index below 0": ("soft", put("contact_grain", -1), "grains that do not exist: give numbers from 0 to"),
    "an index of a half": ("soft", lambda s: s.replace(contact_grain=s.contact_grain + 0.5), "array of whole numbers"),
    "a shift of 5": ("soft", put("contact_shift", 5), "far apart: give grains that touch, and the contact_shift"),
    "a shift of 2**30": ("soft", put("contact_shift", 2**30), "give the number of cell vectors"),
    "a shift of -2**31": ("soft", put("contact_shift", -(2**31)), "give the number of cell vectors"),
    "a radius of 0": ("soft", put("radius", 0.0), "radius contains .*: give radii in m"),
    "a NaN": ("soft", put("position", np.nan), "position contains NaN .*: give finite numbers"),
    "a spin of inf": ("soft", put("angular_velocity", np.inf), "angular_velocity contains NaN or infinite"),
    "a flat cell": ("soft", lambda s: s.replace(cell=s.cell @ np.diag([1, 1, 0.0])), "give three cell vectors in m"),
    "a cell of edges": (
        "soft",
        lambda s: s.replace(cell=np.diag(s.cell)),
        r"cell has the wrong shape .*: give the shape \(3, 3\)",
    ),
    "a list": ("soft", lambda s: s.replace(position=s.position.tolist()), "give a NumPy array of numbers, unmasked"),
    "text": ("soft", lambda s: s.replace(radius=s.radius.astype(str)), "radius is not an array of numbers"),
    "complex": ("soft", lambda s: s.replace(position=s.position + 1j), "position is not an array of numbers"),
    "masked": ("soft", lambda s: s.replace(radius=np.ma.masked_less(s.radius, 8e-5)), "radius is not an array"),
    "a scalar": ("soft", lambda s: s.replace(radius=1e-4), "radius is not an array of numbers"),
    "no scene": ("soft", lambda s: s.replace(scene=None), "scene is a NoneType: give the one of the original State"),
    "a step of a half": ("soft", lambda s: s.replace(step=0.5), "step is not a whole number: give the one"),
    "a time of NaN": ("soft", lambda s: s.replace(time=np.nan, step=5), "time is not a time in s"),
    "joined a half": ("jkr", put("joined", 0.5), "joined contains .*: give 0, or 1$"),
    "a bond below 0": ("bonded", put("bond_length", -1.0), "bond_length contains .*: give 0, or 0.5 to 1.5 times"),
    "a bond of 1e-300 m": ("bonded", put("bond_length", 1e-300), "bond_length contains .*: give 0, or 0.5 to 1.5"),
    "a bond twice as long": ("bonded", put("bond_length", lambda x: 2.0 * x), "bond_length contains"),
    "a bond force of NaN": ("bonded", put("bond_force", np.nan), "bond_force contains NaN"),
    "a long quaternion": ("rods", put("orientation", lambda q: 2.0 * q), "give quaternions of length 1"),
    "a sphere elsewhere": ("rods", put("position", lambda x: x + 2e-5), "position differs from the place"),
    "inertia below 0": ("rods", put("body_inertia", lambda m: -m), "give three positive moments, ascending"),
    "inertia of no body": ("rods", put("body_inertia", lambda m: m * [1, 1, 9]), "at most the sum of the others"),
    "inertia of lead": ("rods", put("body_inertia", lambda m: 1e3 * m), "body_inertia does not fit the spheres"),
    "a volume of 0": ("rods", put("body_volume", 0.0), "body_volume is not positive"),
    "a large volume": ("rods", put("body_volume", lambda v: 9.0 * v), "body_volume does not fit the spheres"),
    "a clump of -1": ("rods", put("body", -1, 0), "body does not number the clumps from 0"),
    "a contact in a clump": ("rods", within_a_clump, "lists a contact within a clump: give spheres of different"),
}


@pytest.mark.parametrize(("name", "change", "words"), WRONG.values(), ids=WRONG)
def test_an_impossible_state_in_memory_is_refused_with_what_to_give(name, change, words, states):
    with pytest.raises(lk.InputError, match=rf"^the state is not one of grains in a cell: .*{words}") as told:
        lk.run(change(states[name]), lk.paths.ConstantVolume(strain=0.002, rate=100), progress=False)
    assert len(str(told.value).splitlines()) == 1


def without_grains(state):
    empty = {name: getattr(state, name)[:0] for name in ("radius", "position", "velocity", "angular_velocity")}
    return rows(state, slice(0)).replace(**empty)


PATH = lk.paths.ConstantVolume(strain=0.002, rate=100)
DOORS = {
    "consolidate": lambda state: lk.consolidate(state, 1e5, progress=False),
    "Element": lk.Element,
    "run_many": lambda state: lk.run_many([(state, PATH)], progress=False),
    "probe": lambda state: lk.probe(state, progress=False),
    "bond": lk.bond,
    "write_state": lambda state: lk.write_state("x.state.nc", state),
}


@pytest.mark.parametrize("change", [with_itself, twice, without_grains, put("radius", 0.0)])
@pytest.mark.parametrize("door", DOORS)
def test_every_door_for_a_state_has_the_same_check(door, change, soft_specimen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(lk.InputError, match=r"^the state is not one of grains in a cell: .*: give "):
        DOORS[door](change(soft_specimen))
    assert not list(tmp_path.iterdir())


def test_states_of_every_kind_pass_at_rest_and_in_motion(states, tmp_path):
    """Also in mixed precision and from files, whose snapshots may be in single precision."""
    for name, state in states.items():
        for precision in ("double", "mixed"):
            engine = Device("fused", precision=precision)(state)
            engine.advance(300, np.array([[0.0, 0.0, 30.0], [0.0, 0.0, 0.0], [0.0, 0.0, -10.0]]))
            lk.write_state(tmp_path / f"{name}.state.nc", engine.state())
            assert lk.read_state(tmp_path / f"{name}.state.nc").digest() == engine.state().digest()


def test_a_grain_may_touch_its_own_image_and_another_grain_across_two_sides():
    """One layer of two grains in a cell two diameters wide: every contact has its own shift."""
    radius, cell = np.full(2, 1e-4), np.diag([1.98e-4, 3.96e-4, 3.96e-4])
    pair = grains_in_cell(lk.Scene(), radius, np.array([[1e-4, 1e-4, 1e-4], [1e-4, 2.98e-4, 1e-4]]), cell)
    state = Device()(pair).state()
    own = state.contact_grain[:, 0] == state.contact_grain[:, 1]
    assert own.sum() == 2 and (~own).sum() == 2
    lk.bond(state)
    with pytest.raises(lk.InputError, match="lists 1 contacts twice"):
        lk.bond(
            rows(state, np.r_[: len(own), 0]).replace(
                contact_shift=np.r_[state.contact_shift, -state.contact_shift[:1]]
            )
        )


@pytest.mark.parametrize(
    ("kind", "name", "value", "words"),
    [
        ("soft", "contact_grain", lambda a: np.r_[a[:1], a[:-1]], "contact_grain lists 1 contacts twice"),
        ("jkr", "joined", lambda a: 0.5 + 0.0 * a, "joined contains values that grains cannot have"),
        ("bonded", "bond_length", lambda a: 1e-300 + 0.0 * a, "bond_length contains values that grains cannot have"),
        ("rods", "orientation", lambda a: 1.1 * a, "orientation is not a rotation"),
        ("rods", "body_inertia", lambda a: -a, "body_inertia contains moments that no body has"),
        ("rods", "body_volume", lambda a: 0.1 * a, "body_volume does not fit the spheres"),
    ],
)
def test_a_file_with_the_same_mistake_is_damaged(kind, name, value, words, states, tmp_path):
    file = tmp_path / "s.state.nc"
    lk.write_state(file, states[kind])
    with changed(file) as dataset:
        dataset[name][:] = value(dataset[name][:])
        if name == "contact_grain":
            dataset["contact_shift"][1] = dataset["contact_shift"][0]
    with pytest.raises(lk.InputError, match=rf"s.state.nc is damaged \({words}.*\): create it again$"):
        lk.read_state(file)
