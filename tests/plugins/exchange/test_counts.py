"""A stated count against the rows that follow, structure that stands twice, and text that is no table."""

import re

import numpy as np
import pytest

import labkit as lk
from labkit.grains.grading import read_grading
from labkit.plugins.exchange import read
from labkit.plugins.exchange.columns import GRAIN
from labkit.plugins.exchange.lammps import BOUNDS
from labkit.plugins.exchange.packing import stated_material
from labkit.plugins.exchange.tables import STATED
from labkit.text.reading import real

BOX = "0 4 xlo xhi\n0 4 ylo yhi\n0 4 zlo zhi\n"
ATOMS = "Atoms # sphere\n\n1 1 1 2500 1 1 1\n2 1 1 2500 1.99 1 1\n3 1 1 2500 3 3 3\n"
ROWS = ["1 .5 1 1 1", "2 .5 1.99 1 1", "3 .5 3 3 3"]
DUMP = (
    "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n{}\n"
    "ITEM: BOX BOUNDS pp pp pp\n0 4\n0 4\n0 4\nITEM: ATOMS id radius x y z\n{}\n"
)
MERCURY = """MercuryDPM 1.0 name two revision 1 repository none
restartFile fileType ONE_FILE saveCount 1
xMin 0 xMax 10 yMin 0 yMax 10 zMin 0 zMax 10
Species 1
LinearViscoelasticSpecies id 0 density 2000 stiffness 1000
Walls 0
Boundaries 0
Particles {}
SphericalParticle id {} indSpecies 0 position 5 9.1 5 radius 1
SphericalParticle id 9 indSpecies 0 position 3 1 5 radius 1
Interactions 0
"""
XYZ = (
    '{}\nLattice="4 0 0 0 4 0 0 0 4" Properties=species:S:1:pos:R:3:radius:R:1 pbc="T T T"\n'
    "Gr 1 1 1 .5\nGr 1.99 1 1 .5\nGr 3 3 3 .5\n"
)


def refused(folder, name, text, message, **known):
    (folder / name).write_text(text)
    with pytest.raises(lk.InputError, match=message) as error:
        read(folder / name, **{"length_unit": "mm", **known})
    assert not re.search("array|reshape|invalid literal|Traceback|float infinity", str(error.value))


@pytest.mark.parametrize("count", ["-3", "3.7", "inf", "1e300", "nan"])
def test_a_count_is_a_whole_number(tmp_path, count):
    refused(tmp_path, "a.dump", DUMP.format(0, count, "\n".join(ROWS)), "is damaged .*whole number|is damaged .*not a")
    refused(tmp_path, "b.dump", DUMP.format(count, 3, "\n".join(ROWS)), "is damaged .*whole number|is damaged .*not a")
    refused(tmp_path, "a.restart", MERCURY.format(count, 7), "is damaged .*whole number", box="10")
    refused(tmp_path, "b.restart", MERCURY.format(2, count), "is damaged .*whole number", box="10")


@pytest.mark.parametrize("count", [2, 5])
def test_a_count_is_that_of_the_rows(tmp_path, count):
    text = f"states {count} atoms, but 3 rows follow"
    refused(tmp_path, "a.dump", DUMP.format(0, count, "\n".join(ROWS)), text)
    refused(tmp_path, "a.data", f"by hand\n\n{count} atoms\n1 atom types\n\n{BOX}\n{ATOMS}", text)
    refused(tmp_path, "c.data", f"by hand\n\n{count} atoms\n\n{BOX}\n{ATOMS}\nVelocities\n\n1 0 0 0 0 0 0\n", text)
    refused(tmp_path, "a.xyz", XYZ.format(count), f"states {count} grains, but 3 rows follow")
    if count == 5:
        refused(tmp_path, "a.restart", MERCURY.format(5, 7), "states 5 Particles, but 2 rows follow", box="10")
    refused(tmp_path, "b.restart", MERCURY.format(1, 7), "states 1 Particles, but 2 rows follow", box="10")


def test_right_counts_are_read(tmp_path):
    (tmp_path / "a.dump").write_text(DUMP.format(0, 3, "\n".join(ROWS)) + "\n\n")
    (tmp_path / "a.data").write_text(f"by hand\n\n3 atoms\n\n{BOX}\n{ATOMS}\nVelocities\n\n1 0 0 0 0 0 0\n")
    (tmp_path / "a.xyz").write_text(XYZ.format(3))
    for name in ("a.dump", "a.data", "a.xyz"):
        np.testing.assert_allclose(
            read(tmp_path / name, length_unit="mm").position * 1e3, [[1, 1, 1], [1.99, 1, 1], [3, 3, 3]]
        )
    (tmp_path / "a.restart").write_text(MERCURY.format(2, 7))
    assert len(read(tmp_path / "a.restart", length_unit="mm", box="10").radius) == 2


LOCAL = "ITEM: TIMESTEP\n1\nITEM: NUMBER OF {0}\n{1}\n{2}ITEM: {0} id1 id2 fx fy fz\n1 2 -3 0 0\n"


@pytest.mark.parametrize("label", ["ENTRIES", "BONDS"])
@pytest.mark.parametrize("box", ["", "ITEM: BOX BOUNDS pp pp pp\n0 4\n0 4\n0 4\n"], ids=["no box", "box"])
def test_a_contact_list_of_liggghts_or_with_a_label_is_read(tmp_path, label, box):
    """LIGGGHTS writes no box, and `dump_modify label` names the entries."""
    (tmp_path / "g.dump").write_text(DUMP.format(1, 3, "\n".join(ROWS)))
    (tmp_path / "c.local").write_text(LOCAL.format(label, 1, box))
    known = {"contacts": tmp_path / "c.local", "length_unit": "mm", "force_unit": "N"}
    assert read(tmp_path / "g.dump", **known).normal_force == pytest.approx([3.0])
    (tmp_path / "c.local").write_text(LOCAL.format(label, 2, box))
    with pytest.raises(lk.InputError, match="states 2 entries, but 1 rows follow"):
        read(tmp_path / "g.dump", **known)


def test_the_number_of_grains_above_a_table_is_compared(tmp_path):
    """Plain XYZ, and a format with its box in two more rows."""
    rows = "1 1 1\n1.99 1 1\n3 3 3\n"
    known = {"columns": "x,y,z", "diameter": "1", "box": "4"}
    refused(tmp_path, "a.xyz", f"3\n0.5\n0 0 0\n4 4 4\n{rows}", "states 3 grains, but 5 rows follow", **known)
    (tmp_path / "b.xyz").write_text(f"3\nAtoms. Timestep: 1000\n{rows}")
    assert len(read(tmp_path / "b.xyz", length_unit="mm", **known).radius) == 3


def test_a_lattice_without_properties_has_species_and_positions(tmp_path):
    (tmp_path / "a.xyz").write_text('2\nLattice="4 0 0 0 4 0 0 0 4" pbc="T T T"\nO 1 1 1\nO 1.99 1 1\n')
    np.testing.assert_allclose(read(tmp_path / "a.xyz", length_unit="mm", diameter="1").cell, 4e-3 * np.eye(3))


def test_a_section_that_stands_twice_is_refused(tmp_path):
    refused(tmp_path, "a.data", f"by hand\n\n3 atoms\n\n{BOX}\n{ATOMS}\n{ATOMS}", "two sections Atoms")


def test_a_row_of_a_dump_with_a_lost_number_is_named(tmp_path):
    refused(
        tmp_path, "a.dump", DUMP.format(0, 3, "\n".join([*ROWS[:2], "3 .5 3 3"])), "row 3 has 4 numbers for 5 columns"
    )


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "---\ncreator: LAMMPS\nnatoms: 1\ndata:\n  - [ 1, 1, 0.5, 1, 1, 1, ]\n...\n", "in YAML: write"),
        ("a.mdpa", "Begin Nodes\n1 1 1 1\n2 1.99 1 1\nEnd Nodes\nBegin Elements S\n1 0 1\n", "a Kratos model part"),
        ("a.geo", "LSMGenGeo 1.2\nBoundingBox 0 0 0 4 4 4\n3\nsimple\n1 1 1 .5 0 0\n", "a geometry of ESyS-Particle"),
        ("a.json", '{"x": [1, 2],\n"y": [1, 2]}\n', "is XML, HTML or JSON"),
        ("a.txt", "grains A\n1 1 1 .5\nend A\ngrains B\n2 2 2 .5\nend B\nsum C\n", "not a table: 4 of 6 lines"),
        ("a.txt", "Once upon a time\nthere was sand\n", "has no rows of 2 or more numbers"),
    ],
)  # fmt: skip
def test_text_that_is_no_table_is_named(tmp_path, name, text, message):
    refused(tmp_path, name, text, message, box="4")


def test_a_cell_that_never_ends_is_refused(tmp_path):
    refused(tmp_path, "a.csv", f'x,y,z,r\n1,1,1,"{"9" * 140_000}"\n1,2,3,.5\n', "a cell that is too long", box="4")


def test_units_of_lammps_contradict_in_words(tmp_path):
    text = "ITEM: UNITS\n{}\n" + DUMP.format(0, 3, "\n".join(ROWS))
    refused(tmp_path, "a.dump", text.format("si"), "--length-unit contradicts the file, which states a unit of 1 m")
    refused(tmp_path, "b.dump", text.format("real"), "states a unit of 1e-10 m")


def test_a_material_names_the_options_that_it_needs():
    words = (
        "density 2650 young 1e8 poisson 0.3 frictionAngle 0.5 alphaKr 0.564 alphaKtw 1 etaRoll 0.1 label x cohesion 0"
    )
    said = stated_material(words.split())
    for text in ("density 2650 (--density)", "poisson 0.3 (--stiffness-ratio)", "etaRoll 0.1 (--rolling-friction)",
                 "alphaKr 0.564 (no counterpart unless 1)", "cohesion 0"):  # fmt: skip
        assert text in said
    assert "label" not in said


@pytest.mark.parametrize("ending", ["npz", "npy"])
def test_columns_of_numpy_files_are_those_that_the_user_names(tmp_path, ending):
    position, size = np.array([[1.0, 1, 1], [1.99, 1, 1], [3, 3, 3]]), np.full(3, 0.5)
    file, known = tmp_path / f"a.{ending}", {"length_unit": "mm", "box": "4"}
    if ending == "npy":
        np.save(file, np.column_stack([size, position]))
        assert read(file, columns="radius,x,y,z", **known).radius == pytest.approx(5e-4)
        return
    np.savez(file, centre=position, q=size, a=[0], b=[1], big=[3.0])
    with pytest.raises(
        lk.InputError, match=r"columns foo,bar is not valid: give ARRAY=COLUMN for arrays of .*centre, q"
    ):
        read(file, columns="foo,bar", **known)
    columns = {"columns": "q=radius", "contact_columns": "a=id1,b=id2,big=fn"}
    found = read(file, **columns, **known, force_unit="N", force_sign="compression", first_id=0)
    assert (
        found.radius == pytest.approx(5e-4) and found.grain.tolist() == [[0, 1]] and list(found.normal_force) == [3.0]
    )


def test_a_pan_is_no_sieve(tmp_path):
    (tmp_path / "s.csv").write_text("diameter_mm,passing_percent\n0.5,100\n0.25,60\n0.125,10\n0,0\n")
    with pytest.raises(lk.InputError, match=r"a size of 0 \(the pan\): give the size of the smallest grains instead"):
        read_grading(str(tmp_path / "s.csv"))
    with pytest.raises(lk.InputError, match=r"a size of 0 \(the pan\)"):
        read_grading("sieve diameters=0mm,0.1mm,0.2mm passing=0,0.5,1")


def test_patterns_end_for_texts_of_any_length():
    """Each took a time that grows with the square or cube of the text: hours for these."""
    blanks = " " * 200_000
    assert GRAIN.canonical(f"x ({blanks}a b") is None
    assert STATED.search(f"step{blanks}x") is None
    assert BOUNDS.search("\n" * 2_000_000 + "x") is None
    with pytest.raises(ValueError, match="is not a number"):
        real("1" * 2_000_000 + "x")


def test_a_heading_of_any_length_is_read(tmp_path):
    (tmp_path / "s.csv").write_text(f"{'size' * 100}{'_' * 200_000}x,passing_percent\n0.5,100\n0.25,0\n")
    with pytest.raises(lk.InputError, match="two columns with the headings"):
        read_grading(str(tmp_path / "s.csv"))
