"""Small files as other programs and their users write them, each with one unusual feature."""

import warnings

import numpy as np
import pytest

import labkit as lk
from labkit.cli.dispatch import main
from labkit.cli.parser import Parser
from labkit.plugins.exchange import read

BOX = "0 4 xlo xhi\n0 4 ylo yhi\n0 4 zlo zhi\n"
SPHERES = "1 1 1.0 2650 1 1 1\n2 1 1.0 2650 1 1 1.99\n3 1 1.0 2650 3 3 3\n"
DUMP = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ENTRIES\n1\nITEM: BOX BOUNDS pp pp pp\n0 4\n0 4\n0 4\nITEM: ENTRIES {}\n{}\n"


def data_file(folder, section, rows=SPHERES):
    file = folder / "a.data"
    file.write_text(f"comment\n\n3 atoms\n1 atom types\n\n{BOX}\n{section}\n\n{rows}")
    return file


@pytest.mark.parametrize("section", ["Atoms", "Atoms # sphere", "Atoms  ", " Atoms"])
def test_no_atom_is_lost_below_a_bare_line(tmp_path, section):
    found = read(data_file(tmp_path, section), length_unit="mm")
    np.testing.assert_allclose(found.position * 1e3, [[1, 1, 1], [1, 1, 1.99], [3, 3, 3]])


def test_atoms_without_sizes_are_not_taken_for_grains(tmp_path):
    molecules = "1 1 1 -0.8 1 1 1\n2 1 1 0.4 1 1 1.99\n3 2 1 0.4 3 3 3\n"
    with pytest.raises(lk.InputError, match=r"atoms of an unnamed style: name the 7 columns .* with --columns"):
        read(data_file(tmp_path, "Atoms", molecules), length_unit="mm")
    with pytest.raises(lk.InputError, match="atom style full, which has no grain sizes"):
        read(data_file(tmp_path, "Atoms # full", molecules), length_unit="mm")
    found = read(data_file(tmp_path, "Atoms", molecules), length_unit="mm", columns="id,-,-,-,x,y,z", diameter="1")
    np.testing.assert_allclose(found.radius, 5e-4)


def pair(folder, names="x y z r", rows="1 1 1 0.5\n1 1 1.99 0.5\n3 3 3 0.5\n", first=""):
    file = folder / "g.txt"
    file.write_text(f"{first}{names}\n{rows}")
    return file


def test_a_value_may_begin_with_a_hyphen(tmp_path):
    parser = Parser("labkit x")
    parser.add_argument("--contact-columns")
    parser.add_argument("--pressure")
    words = parser.read(["--contact-columns", "-,id1,id2", "--pressure", "-300kPa"])
    assert (words.contact_columns, words.pressure) == ("-,id1,id2", "-300kPa")
    with pytest.raises(lk.InputError, match="-300kPa is not an option of labkit x"):
        parser.read(["--pressure", "1", "-300kPa"])


def test_unknown_names_are_listed_with_their_numbers(tmp_path):
    contacts = tmp_path / "c.local"
    contacts.write_text(DUMP.format("index c_1[1] c_1[2]", "1 1 2"))
    given = {"contacts": contacts, "box": "4", "length_unit": "mm"}
    with pytest.raises(lk.InputError, match=r"no column id1; its columns are 1 index, 2 c_1\[1\], 3 c_1\[2\]: name"):
        read(pair(tmp_path), **given)
    assert len(read(pair(tmp_path), contact_columns="-,id1,id2", first_id=1, **given).grain) == 1


def test_all_questions_come_in_one_round(tmp_path):
    contacts = tmp_path / "c.csv"
    contacts.write_text("id1,id2,fn,fs_x,fs_y,fs_z\n1,2,-3,0,0,0\n")
    with pytest.raises(lk.InputError) as error:
        read(pair(tmp_path, "x y z size"), contacts=contacts)
    for option in ("box", "size", "length-unit", "force-unit", "force-sign", "force-on", "first-id"):
        assert f"give --{option} " in str(error.value)


def test_overlaps_may_be_positive_in_tension_too(tmp_path):
    """They then have the sign of the forces; only a different size is reported."""
    contacts = tmp_path / "c.csv"
    given = {"contacts": contacts, "box": "4", "length_unit": "mm", "first_id": 0, "force_unit": "N"}
    for overlap, said in ((-0.01, False), (0.01, False), (0.02, True)):
        contacts.write_text(f"id1,id2,fn,overlap\n0,1,-3,{overlap}\n")
        findings = read(pair(tmp_path), force_sign="tension", **given).findings
        assert any("the overlaps in the file" in str(one) for one in findings) is said


def test_gaps_that_a_time_step_opens_are_no_finding(tmp_path):
    contacts = tmp_path / "c.csv"
    contacts.write_text("id1,id2,fn\n0,1,3\n")
    given = {"contacts": contacts, "box": "4", "length_unit": "mm", "first_id": 0, "force_unit": "N"}
    for z, said in ((2.0005, False), (2.01, True)):
        grains = pair(tmp_path, rows=f"1 1 1 0.5\n1 1 {z} 0.5\n3 3 3 0.5\n")
        findings = read(grains, force_sign="compression", **given).findings
        assert any("do not touch" in str(one) for one in findings) is said


@pytest.mark.parametrize("first", ["", "##PERIODIC:: 4 4 4\n"])
def test_a_column_may_have_words(tmp_path, first):
    rows = "1 ball 1 1 1 0.5\n2 ball 1 1 1.99 0.5\n3 ball 3 3 3 0.5\n"
    box = {} if first else {"box": "4"}
    for names, columns in (("id kind x y z r", None), ("", "id,-,x,y,z,radius")):
        found = read(pair(tmp_path, names, rows, first), length_unit="mm", columns=columns, **box)
        np.testing.assert_allclose(found.cell, 4e-3 * np.eye(3))
        np.testing.assert_allclose(found.radius, 5e-4)
    with pytest.raises(lk.InputError, match=r"lacks a number in line [23] \(1.? ball|has sizes "):
        read(pair(tmp_path, "", rows, first), length_unit="mm", columns="id,radius,x,y,z,-", **box)


def test_a_sphere_pack_without_a_period_takes_the_given_box(tmp_path):
    (tmp_path / "g.spheres").write_text("1 1 1 0.5\n1 1 1.99 0.5\n3 3 3 0.5\n")
    found = read(tmp_path / "g.spheres", format="sphere_pack", length_unit="mm", box="4")
    np.testing.assert_allclose(found.cell, 4e-3 * np.eye(3))
    np.testing.assert_allclose(found.position * 1e3, [[1, 1, 1], [1, 1, 1.99], [3, 3, 3]])


@pytest.mark.filterwarnings("ignore:the grains are not in equilibrium", "ignore:the cell is only")
def test_a_box_that_is_larger_than_the_packing_is_named(tmp_path):
    """As in data files of programs that write the box of the walls, or of the whole domain."""
    rows = "".join(f"{1 + 0.99 * x} {1 + 0.99 * y} {1 + 0.99 * z} 0.5\n" for x, y, z in np.ndindex(4, 4, 4))
    file = pair(tmp_path, rows=rows)
    with pytest.warns(
        UserWarning, match=r"but grains have 4\.5 contacts: is the box larger than the packing\?"
    ) as said:
        lk.import_state(file, box="12", length_unit="mm")
    with warnings.catch_warnings(record=True) as of_its_own_box:
        warnings.simplefilter("always")
        lk.import_state(file, box="3.96", length_unit="mm")
    assert said and not any("larger than the packing" in str(one.message) for one in of_its_own_box)


@pytest.mark.filterwarnings("ignore:no grains touch")
def test_wide_gradings_are_imported_with_a_word(tmp_path):
    file = pair(tmp_path, rows="1 1 1 0.06\n1 1 2 0.72\n3 3 3 0.06\n")
    with pytest.warns(UserWarning, match="the diameters differ 12-fold"):
        state = lk.import_state(file, box="4", length_unit="mm")
    assert state.number_of_grains == 3


@pytest.mark.filterwarnings("ignore:the void ratio is 39")
def test_the_mean_diameter_shows_a_wrong_unit_of_length(tmp_path):
    with pytest.warns(UserWarning, match="the mean diameter is 1 m"):
        lk.import_state(data_file(tmp_path, "Atoms # sphere"), length_unit="m")


@pytest.mark.filterwarnings("ignore:the grains")
def test_the_stress_of_the_file_can_be_kept(tmp_path, soft_specimen):
    """Forces come from grains ten times as stiff as labkit's default: the modulus is found, and keeps the stress."""
    snapshot, cell = soft_specimen.snapshot(), ",".join(map(repr, (1e3 * soft_specimen.cell).ravel().tolist()))
    grains, contacts = tmp_path / "g.csv", tmp_path / "c.csv"
    rows = np.column_stack([soft_specimen.position, soft_specimen.radius]) * 1e3
    np.savetxt(grains, rows, fmt="%.17g", delimiter=",", header="x,y,z,radius", comments="")
    force = np.column_stack([snapshot.contacts.grain, 10.0 * snapshot.contacts.normal_force])
    np.savetxt(contacts, force, fmt="%.17g", delimiter=",", header="id1,id2,fn", comments="")
    given = {"contacts": contacts, "box": cell, "length_unit": "mm", "first_id": 0, "force_unit": "N"}
    given |= {"force_sign": "compression"}
    with pytest.warns(UserWarning) as said:
        lk.import_state(grains, **given)
    text = next(str(one.message) for one in said if "--young-modulus" in str(one.message))
    modulus = float(text.split("--young-modulus ")[1].split()[0])
    assert modulus == pytest.approx(10.0 * lk.Scene().young_modulus, rel=1e-4)
    state = lk.import_state(grains, lk.Scene(young_modulus=modulus), **given)
    normal = lk.mean_stress(lk.love_stress(read(grains, **given).snapshot(lk.Scene())))
    assert lk.mean_stress(lk.love_stress(state.snapshot())) == pytest.approx(normal, rel=1e-4)


def test_a_driver_file_may_have_several_tests(tmp_path, capsys):
    from labkit.plugins.incremental.driver_file import read_test

    step = "*LinearLoad\n10 1 1.0\n*Cartesian\n0 0.0\n0 0.0\n0 {}\n0 0\n0 0\n0 0\n*End\n"
    file = tmp_path / "test.inp"
    file.write_text("a.out\n" + step.format(-0.001) + "\nb.out # second\n" + step.format(-0.002) + "any text\n")
    first, second = read_test(file), read_test(file, block=2)
    assert (first.output, second.output, second.heading) == ("a.out", "b.out", "second")
    assert second.steps[0].strain == tuple(2.0 * np.array(first.steps[0].strain))
    assert "has 2 tests, of which number 1 is carried out: --block chooses another" in first.notes[0]
    for encoding in ("utf-8-sig", "utf-16", "cp1252"):
        (tmp_path / "other.inp").write_bytes(file.read_text().replace("second", "zw\u00f6lf").encode(encoding))
        assert read_test(tmp_path / "other.inp", block=2).heading == "zw\u00f6lf"
    assert main(["driver", str(file), "--on", "model", "--block=3"]) == 2
    assert "--block 3 is not in" in capsys.readouterr().err


def test_a_dump_of_some_atoms_is_doubted(tmp_path):
    """As `dump_modify thresh type == 1` and a dump of a group write it."""
    head = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n3\nITEM: BOX BOUNDS pp pp pp\n0 4\n0 4\n0 4\n"
    for ids, said in (((2, 5, 9), ["5 ids from 2 to 9 are not in the dump: is it one of all atoms?"]), ((3, 1, 2), [])):
        rows = "".join(f"{number} {k} 1 1 0.5\n" for k, number in enumerate(ids, 1))
        (tmp_path / "a.dump").write_text(f"{head}ITEM: ATOMS id x y z radius\n{rows}")
        findings = map(str, read(tmp_path / "a.dump", length_unit="mm").findings)
        assert [each for each in findings if "ids" in each] == said


def test_a_second_frame_in_a_table_is_no_grain(tmp_path):
    """As in the .data files of MercuryDPM, in which a line of eight numbers is above the fourteen of each grain."""
    frame = "2 {} 0 0 0 4 4 4\n1 1 1 0 0 0 0.5 0 0 0 0 0 0 0\n1 1 1.99 0 0 0 0.5 0 0 0 0 0 0 0\n"
    given = {"length_unit": "mm", "box": "4", "columns": "x,y,z,-,-,-,radius,-,-,-,-,-,-,-"}
    (tmp_path / "one.data").write_text(frame.format(0.5))
    assert len(read(tmp_path / "one.data", **given).radius) == 2
    (tmp_path / "two.data").write_text("".join(frame.format(k) + frame.partition("\n")[2] * 5 for k in range(2)))
    with pytest.raises(
        lk.InputError, match="has 8 cells in line 14, and 14 in other lines: give a file with one frame"
    ):
        read(tmp_path / "two.data", **given)


def test_a_void_ratio_of_no_packing_is_doubted_also_with_few_contacts(tmp_path):
    rows = "".join(f"{1 + 0.99 * k} 1 1 0.5\n" for k in range(4)) + "3 3 9 0.5\n"
    findings = [str(each) for each in read(pair(tmp_path, rows=rows), box="12", length_unit="mm").findings]
    assert any("contacts: is the box larger than the packing?" in each for each in findings)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("LammpS RestartT\0\0\0", "a binary restart file of LAMMPS: write a data file with lmp -restart2data"),
        ("Number of particles = 3\nA = 1 Angstrom\n1 2 3\n1 2 3\n", "a configuration of AtomEye"),
    ],
)
def test_other_files_of_lammps_are_named(tmp_path, text, said):
    (tmp_path / "a").write_text(text)
    with pytest.raises(lk.InputError, match=said):
        read(tmp_path / "a")
