"""Import and export: round trips, information that files lack, and mistakes that the checks notice."""

import dataclasses

import numpy as np
import pytest

import labkit as lk
from labkit import import_snapshot, import_state
from labkit.cli.dispatch import main
from labkit.grains.state_file import read_state
from labkit.plugins.exchange import FORMATS, read
from labkit.plugins.exchange.pairs import nearest_shift, overlapping_pairs, widths

# notes on the small specimens, which test_foreign.py and others examine
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::labkit.errors.LabkitWarning")]

EXACT = {"lammps_data": "s.data", "ondem": "s.vtkhdf", "sphere_pack": "s.spheres"}


@pytest.fixture
def table(straight, tmp_path):
    """A table of grains in mm, and its box as an answer."""
    rows = np.column_stack([straight.position * 1e3, straight.radius * 1e3])
    np.savetxt(tmp_path / "g.txt", rows, header="x y z r", fmt="%.17g")
    return tmp_path / "g.txt", {"box": box_of(straight.cell * 1e3), "length_unit": "mm"}


def box_of(cell):
    return ",".join(repr(float(value)) for value in cell.ravel())


def same_packing(found, state, tolerance=1e-12):
    """The same radii, the same contacts and the same overlaps; positions may have moved by a cell."""
    np.testing.assert_allclose(found.radius, state.radius, rtol=tolerance)
    np.testing.assert_array_equal(found.contact_grain, state.contact_grain)
    overlap, expected = found.snapshot().contacts.overlap, state.snapshot().contacts.overlap
    np.testing.assert_allclose(overlap, expected, atol=tolerance * state.radius.mean())


@pytest.mark.parametrize("name", EXACT)
def test_a_state_survives_a_round_trip(name, straight, sheared, tmp_path):
    if name == "ondem":
        pytest.importorskip("h5py", reason="h5py is not installed")
    state = straight if name == "sphere_pack" else sheared
    file = tmp_path / EXACT[name]
    FORMATS[name]().write(state, file)
    known = {"length_unit": "m"} if name == "sphere_pack" else {}
    found = import_state(file, state.scene, **known)
    same_packing(found, state)
    if name == "ondem":  # the contacts too, with their forces
        again = import_snapshot(file, state.scene)
        assert lk.love_stress(again) == pytest.approx(lk.love_stress(state.snapshot()), rel=1e-9, abs=1e-3)


def test_a_script_for_yade_restores_the_stress(straight, yade_files):
    folder, yade = yade_files
    love = lk.love_stress(straight.snapshot()).T
    np.testing.assert_allclose(yade["stress"], love, rtol=1e-9, atol=1e-6 * love.max())
    with pytest.raises(lk.InputError, match="only the rolling_resistance law"):
        other = straight.replace(scene=dataclasses.replace(straight.scene, law="spring_dashpot"))
        FORMATS["yade_script"]().write(other, folder / "other.py")


def test_texts_of_yade_are_read(straight, yade_files):
    """A SpherePack knows its box, YADE's table of grains does not; both have six digits."""
    folder, _ = yade_files
    for file, box in (("packed.txt", None), ("exported.txt", box_of(straight.cell))):
        found = import_state(folder / file, straight.scene, length_unit="m", box=box)
        np.testing.assert_allclose(found.radius, straight.radius, rtol=1e-5)
        assert len(found.contact_grain) == pytest.approx(len(straight.contact_grain), rel=0.02)


def test_a_box_may_be_text_or_numbers(table):
    file, known = table
    expected = read(file, **{**known, "box": "10,10,10"}).cell
    for box in (10, 10.0, (10, 10, 10), np.array([10.0, 10.0, 10.0]), 10.0 * np.eye(3)):
        assert np.array_equal(read(file, **{**known, "box": box}).cell, expected)
    with pytest.raises(lk.InputError, match="box '10,wide' is not a box: give 1, 3 or 9 numbers"):
        read(file, **{**known, "box": (10, "wide")})


@pytest.mark.parametrize(
    ("field", "text", "reason"),
    [
        ("length_unit", "1.2.3 mm", "is not a unit"),
        ("length_unit", ". mm", "is not a unit"),
        ("length_unit", "1e999 mm", "is not positive and finite"),
        ("force_unit", "1..2 N", "is not a unit"),
        ("box", "0,0,0", "has no volume"),
    ],
)
def test_a_unit_or_box_that_is_no_size_is_refused(table, field, text, reason):
    file, known = table
    with pytest.raises(lk.InputError, match=f"{field}.* {reason}: give"):
        read(file, **{**known, field: text})


def test_what_a_file_does_not_say_is_asked_for(table):
    file, known = table
    for missing in known:
        rest = {name: value for name, value in known.items() if name != missing}
        with pytest.raises(lk.InputError, match=f"give --{missing.replace('_', '-')}"):
            read(file, **rest)
    np.savetxt(file, np.loadtxt(file))
    with pytest.raises(lk.InputError, match="give --size"):
        read(file, **known)
    assert not [found for found in read(file, size="radius", **known).findings if found.serious]


def test_diameters_taken_for_radii_are_noticed(table, tmp_path, capsys):
    file, known = table
    np.savetxt(file, np.loadtxt(file) * [1, 1, 1, 2])  # without its header
    words = ["import", str(file), f"--box={known['box']}", "--length-unit", "mm", "-o", str(tmp_path / "o.state.nc")]
    assert main([*words, "--size", "radius"]) == 2
    assert "--box" in capsys.readouterr().err
    assert not (tmp_path / "o.state.nc").exists()
    assert main([*words, "--size", "diameter"]) == 0
    state = read_state(tmp_path / "o.state.nc")
    assert state.snapshot().contacts.overlap.min() > 0.0 and state.provenance
    assert state.scene.mean_diameter == pytest.approx(2.0 * state.radius.mean())


def test_radii_taken_for_diameters_are_noticed(table):
    file, known = table
    np.savetxt(file, np.loadtxt(file))
    texts = [str(found) for found in read(file, size="diameter", **known).findings]
    assert any("are the sizes radii, not diameters?" in text for text in texts), texts


@pytest.mark.parametrize("sign, on", [("tension", "first"), ("compression", "second")])
def test_wrong_signs_are_noticed(sign, on, straight, tmp_path):
    contacts = straight.snapshot().contacts
    np.savez(
        tmp_path / "s.npz",
        position=straight.position,
        radius=straight.radius,
        cell=straight.cell,
        id1=contacts.grain[:, 0],
        id2=contacts.grain[:, 1],
        fn=contacts.normal_force,
        shear_force=contacts.tangential_force,
    )
    answers = {"length_unit": "m", "force_unit": "N", "force_sign": sign, "force_on": on, "first_id": 0}
    texts = [str(found) for found in read(tmp_path / "s.npz", **answers).findings]
    expected = "in tension" if sign == "tension" else "is --force-on right?"
    assert any(expected in text for text in texts), texts
    if sign == "tension":
        with pytest.raises(lk.InputError, match="in tension"):
            import_snapshot(tmp_path / "s.npz", **answers)
    else:
        right = read(tmp_path / "s.npz", **{**answers, "force_on": "first"})
        assert not any("force-on" in str(found) for found in right.findings)


def test_duplicates_narrow_boxes_and_missing_contacts_are_noticed(straight, tmp_path):
    radius = np.full(3, 1.0)
    position = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [2.9, 1.0, 1.0]])
    np.savez(tmp_path / "p.npz", position=position, radius=radius, cell=3.5 * np.eye(3))
    texts = " ".join(map(str, read(tmp_path / "p.npz", length_unit="mm").findings))
    assert "less than two grains" in texts and "at the same place" in texts
    contacts = straight.snapshot().contacts
    inside = (straight.contact_shift == nearest_shift(straight.position, straight.cell, contacts.grain)).all(axis=1)
    assert inside.all()
    wrapped = straight.snapshot().wrapped_position
    across = (nearest_shift(wrapped, straight.cell, contacts.grain) != 0).any(axis=1)
    grain = contacts.grain[~across]
    np.savez(
        tmp_path / "c.npz", position=wrapped, radius=straight.radius, cell=straight.cell,
        id1=grain[:, 0], id2=grain[:, 1],
    )  # fmt: skip
    texts = " ".join(map(str, read(tmp_path / "c.npz", length_unit="m", first_id=0).findings))
    assert f"{across.sum()} of them across faces of the box" in texts


def test_pickled_objects_are_refused(tmp_path):
    np.save(tmp_path / "o.npy", np.array([{"radius": 1}], dtype=object))
    with pytest.raises(lk.InputError, match="could run any code"):
        read(tmp_path / "o.npy")


def test_all_overlapping_pairs_are_found_in_a_tilted_cell():
    """Compared with a search of all images of all pairs, at a size ratio of 5."""
    rng = np.random.default_rng(4)
    cell = np.array([[1.0, 0.5, -0.3], [0.0, 0.9, 0.4], [0.0, 0.0, 0.8]])
    radius, position = rng.uniform(0.02, 0.1, 40), rng.uniform(-1, 1, (40, 3))
    grain, shift, overlap = overlapping_pairs(position, radius, cell)
    assert widths(cell).min() > 4 * radius.max()
    reach = np.array([(i, j, k) for i in range(-5, 6) for j in range(-5, 6) for k in range(-4, 5)])
    expected = set()
    for a in range(40):
        for b in range(a + 1, 40):
            distance = np.linalg.norm(position[b] - position[a] + reach @ cell.T, axis=1)
            expected |= {(a, b, *reach[k]) for k in np.flatnonzero(distance < radius[a] + radius[b])}
    assert {(*pair, *move) for pair, move in zip(grain.tolist(), shift.tolist(), strict=True)} == expected
    assert overlap.min() > 0.0 and len(expected) > 10
    np.testing.assert_array_equal(nearest_shift(position, cell, grain), shift)
