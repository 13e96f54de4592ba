"""Units, walls, instants and damage in tables of other programs; small files with values known by hand."""

import gzip

import numpy as np
import pytest

import labkit as lk
from labkit import import_snapshot
from labkit.cli.dispatch import main
from labkit.plugins.exchange import read

ROWS = "1,1,1,0.5\n1,1,1.99,0.5\n3,3,3,0.5\n"
GIVEN = {"box": "4", "first_id": 0, "force_sign": "compression", "force_on": "first"}


def written(folder, text, name="g.csv", encoding="utf-8"):
    file = folder / name
    file.write_bytes(text.encode(encoding))
    return file


def notes(found):
    return " ".join(map(str, found.findings))


def require_two_in_contact(found):
    """Three grains of 1 mm, the first two 0.01 mm into each other."""
    np.testing.assert_allclose(found.radius, 5e-4)
    np.testing.assert_allclose(found.cell, 4e-3 * np.eye(3))
    assert found.grain.tolist() == [[0, 1]]
    np.testing.assert_allclose(found.state(lk.Scene()).snapshot().contacts.overlap, [1e-5], rtol=1e-9)


@pytest.mark.parametrize(
    "header, rows",
    [
        ("x [mm],y [mm],z [mm],radius [m]", ROWS.replace("0.5", "0.0005")),
        ("x (mm),y (mm),z (mm),diameter (um)", ROWS.replace("0.5", "1000")),
        ("x_mm,y_mm,z_mm,radius_mm", ROWS),
        ("x in mm,y in mm,z in mm,d in cm", ROWS.replace("0.5", "0.1")),
        ("Position X [mm],Position Y [mm],Position Z [mm],Radius [\u00b5m]", ROWS.replace("0.5", "500")),
        ("x,y,z,r\nmm,mm,mm,um", ROWS.replace("0.5", "500")),
    ],
)
@pytest.mark.parametrize("given", [{}, {"length_unit": "mm"}])
def test_each_column_has_the_unit_of_its_header(tmp_path, header, rows, given):
    require_two_in_contact(read(written(tmp_path, f"{header}\n{rows}", encoding="cp1252"), box="4", **given))


def test_a_unit_that_contradicts_the_headers_is_refused(tmp_path):
    file = written(tmp_path, f"x [mm],y [mm],z [mm],radius [mm]\n{ROWS}")
    with pytest.raises(lk.InputError, match=r"--length-unit contradicts the headers x \[mm\], y"):
        read(file, box="4", length_unit="cm")
    require_two_in_contact(read(file, box="4", length_unit="0.001 m"))


def test_a_header_without_a_unit_has_the_given_one(tmp_path):
    file = written(tmp_path, f"x [mm],y [mm],z [mm],radius\n{ROWS}")
    require_two_in_contact(read(file, box="4", length_unit="mm"))
    with pytest.raises(lk.InputError, match="no length unit"):
        read(file, box="4")
    assert len(import_snapshot(file, box="4", length_unit="mm").contacts) == 1
    voxels = written(tmp_path, f"x [px],y [px],z [px],radius [px]\n{ROWS}")
    require_two_in_contact(read(voxels, box="4", length_unit="1 mm"))


@pytest.mark.parametrize(
    "given, message",
    [
        ({"size": "diameter"}, "--size contradicts the file, which states radius"),
        ({"diameter": "1"}, "--diameter is not used"),
    ],
)
def test_answers_that_contradict_the_file_are_refused(tmp_path, given, message):
    with pytest.raises(lk.InputError, match=message):
        read(written(tmp_path, f"x,y,z,radius\n{ROWS}"), box="4", length_unit="mm", **given)


def contact_of(folder, text, **given):
    grains = written(folder, f"x [mm],y [mm],z [mm],radius [mm]\n{ROWS}")
    return read(grains, contacts=written(folder, text, "c.csv"), **{**GIVEN, **given})


def test_each_force_has_the_unit_of_its_header(tmp_path):
    text = "i,j,fn [kN],ftx [mN],fty [N],ftz [mN],overlap [um]\n0,1,0.001,100,0,0,10\n"
    found = contact_of(tmp_path, text)
    np.testing.assert_allclose(found.normal_force, [1.0])
    np.testing.assert_allclose(found.tangential_force, [[0.1, 0.0, 0.0]])
    assert "overlaps in the file" not in notes(found)
    with pytest.raises(lk.InputError, match="--force-unit contradicts the headers"):
        contact_of(tmp_path, text, force_unit="uN")


@pytest.mark.parametrize("wall", ["SA", "sphere-wall", "ball-facet", "Particle-Geometry", "mesh", "PW"])
@pytest.mark.parametrize("own", ["SS", "ball-ball"])
def test_contacts_with_walls_are_left_out(tmp_path, wall, own):
    """As DEM-Engine, PFC and EDEM write them: a wall has a number too, which may be that of a grain."""
    text = f"contact_type,geoA,geoB,f_x,f_y,f_z\n{own},0,1,0,0,-2\n{wall},1,2,0,0,3\n"
    found = contact_of(tmp_path, text, force_unit="N", force_sign=None)
    assert found.grain.tolist() == [[0, 1]] and found.normal_force.tolist() == [2.0]
    assert "1 contacts with walls are left out" in notes(found)


def test_a_wall_may_have_a_name_instead_of_a_number(tmp_path):
    text = "id1,id2,fn\n0,1,2\n1,wall_3,5\n"
    assert contact_of(tmp_path, text, force_unit="N").grain.tolist() == [[0, 1]]


DUMP = "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF {}\n{}\nITEM: BOX BOUNDS pp pp pp\n0 4\n0 4\n0 4\nITEM: {} {}\n{}\n"


def test_grains_and_contacts_of_different_steps_are_refused(tmp_path):
    grains = "1 1 1 1 0.5\n2 1 1 1.99 0.5\n3 3 3 3 0.5"
    written(tmp_path, DUMP.format(40002, "ATOMS", 3, "ATOMS", "id x y z radius", grains), "g.dump")
    for step in (40001, 40002):
        written(tmp_path, DUMP.format(step, "ENTRIES", 1, "ENTRIES", "id1 id2", "1 2"), "c.local")
        texts = notes(read(tmp_path / "g.dump", contacts=tmp_path / "c.local", length_unit="mm"))
        assert ("the grains are of step 40002, the contacts of step 40001" in texts) == (step == 40001)
    written(tmp_path, DUMP.format(40001, "ENTRIES", 1, "ENTRIES", "id1 id2", "1 2"), "c.local")
    with pytest.raises(lk.InputError, match="--accept"):
        lk.import_state(tmp_path / "g.dump", contacts=tmp_path / "c.local", length_unit="mm")


@pytest.mark.parametrize(
    "line, other, differ",
    [
        ("# time = 0.5 s", "# time = 0.75 s", True),
        ("# Step: 100", "# timestep 200", True),
        ("TIME: 0.5", "TIME: 0.5", False),
        ("# measured at 10:30", "# time 10:45", False),
    ],
)
def test_times_in_comments_are_compared(tmp_path, line, other, differ):
    grains = written(tmp_path, f"{line}\nx,y,z,r\n{ROWS}")
    contacts = written(tmp_path, f"{other}\nid1,id2,fn\n0,1,3\n", "c.csv")
    found = read(grains, contacts=contacts, length_unit="mm", force_unit="N", **GIVEN)
    assert ("the grains are of " in notes(found)) == differ


@pytest.mark.parametrize("name, differ", [("c_0100.csv", False), ("c_0200.csv", True), ("c2.csv", False)])
def test_numbers_in_the_names_of_files_are_compared(tmp_path, name, differ):
    grains = written(tmp_path, f"x,y,z,r\n{ROWS}", "g_0100.csv")
    contacts = written(tmp_path, "id1,id2,fn\n0,1,3\n", name)
    found = read(grains, contacts=contacts, length_unit="mm", force_unit="N", **GIVEN)
    assert ("are they of one step?" in notes(found)) == differ


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize(
    "text",
    [
        f"Points_0,Points_1,Points_2,radius\n{ROWS}",
        f'"Points:0","Points:1","Points:2","radius"\n{ROWS}',
        f"PositionX,PositionY,PositionZ,Radius\n{ROWS}",
        f"Sample A\nexported by hand\n\nx,y,z,r\n{ROWS}",
        f"x;y;z;r\n{ROWS.replace(',', ';').replace('.', ',')}",
        f"x y z r\n{ROWS.replace(',', ' ').replace('0.5', '5.0D-01')}",
        f"# x y z r\n{ROWS.replace(',', chr(9))}",
        f"% x y z r\n{ROWS.replace(',', '  ')}",
        f"# by hand\n# in July\n\n# x y z r\n{ROWS.replace(',', ' ')}",
    ],
)
def test_tables_of_other_programs(tmp_path, text, encoding):
    require_two_in_contact(read(written(tmp_path, text, encoding=encoding), box="4", length_unit="mm"))


def test_a_compressed_table_is_read(tmp_path):
    (tmp_path / "g.csv.gz").write_bytes(gzip.compress(f"x,y,z,r\n{ROWS}".encode()))
    require_two_in_contact(read(tmp_path / "g.csv.gz", box="4", length_unit="mm"))


def test_titles_and_decimal_commas_are_said(tmp_path):
    text = f"Sample A\nx;y;z;r\n{ROWS.replace(',', ';').replace('.', ',')}"
    found = read(written(tmp_path, text), box="4", length_unit="mm")
    assert "1 lines above the table are not read" in notes(found) and "decimal commas" in notes(found)


@pytest.mark.parametrize(
    "text, message",
    [
        ("##PERIODIC:: 1. 2. 3.\n0 Sphere 1 1 1 0.5\n1 Sphere 1 1 2 0.5\n", "6 columns without names: give --columns"),
        ("3\n10 10 10\n0 1 1 1\n0 1 1 2\n0 3 3 3\n", "4 columns without names: give --columns"),
        (f"x,y,z,r\n{ROWS}1,1,,0.5\n", r"lacks a number in line 5 \(1, 1, , 0.5\), column z"),
        (f"x,y,z,r\n{ROWS}1,1,1,0.5,7\n", "has 5 cells in line 5, not 4"),
    ],
)
def test_messages_are_one_sentence_of_labkit(tmp_path, text, message):
    file = written(tmp_path, text)
    with pytest.raises(lk.InputError, match=message) as error:
        read(file, length_unit="mm")
    assert "damaged" not in str(error.value) and "Error" not in str(error.value)


@pytest.mark.parametrize("name", ["grains.xlsx", "grains.csv", "grains.dat"])
def test_other_files_are_named_before_a_format_is_asked_for(tmp_path, name):
    for content, message in ((b"PK\x03\x04ab", "Excel workbook"), (b"\xfd7zXZ\0", "xz"), (b"x\0y\0", "is not text")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(lk.InputError, match=message):
            read(tmp_path / name, box="4", length_unit="mm")


def test_an_empty_cell_in_a_column_that_is_not_used_is_no_fault(tmp_path):
    text = "x,y,z,r,v\n1,1,1,0.5,1\n1,1,1.99,0.5,\n3,3,3,0.5,2\n"
    require_two_in_contact(read(written(tmp_path, text), box="4", length_unit="mm"))


@pytest.mark.parametrize("size", [0.5, 50.0])
def test_grains_of_metres_are_imported_and_run(tmp_path, size, capsys):
    """A spread of diameters above 0.1 m once asked for --smallest, which nobody had given."""
    rows = "0,0,0,1\n1.9,0,0,1\n0,4,4,2\n"
    scaled = "\n".join(",".join(str(float(cell) * size) for cell in row.split(",")) for row in rows.split())
    file = written(tmp_path, f"x,y,z,r\n{scaled}\n")
    output = str(tmp_path / "o.state.nc")
    assert main(["import", str(file), f"--box={10 * size}", "--length-unit", "m", "-o", output]) == 0
    state = lk.read_state(output)
    assert state.scene.sizes.largest > 0.1 and state.radius.max() == 2.0 * size
    assert len(state.contact_grain) == 1
