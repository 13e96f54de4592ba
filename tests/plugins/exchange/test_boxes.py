"""Boxes of other programs: reduced before they are judged, sheared, too narrow; headers of LAMMPS; MercuryDPM."""

import itertools

import numpy as np
import pytest

import labkit as lk
from labkit import import_state
from labkit.cli.dispatch import main
from labkit.plugins.exchange import read

ROWS = "0.2,1,1,0.5\n3.5,1,1.7,0.5\n2,2.5,3,0.5\n2.3,3.2,3.6,0.5\n"
MERCURY = """MercuryDPM 0.14 name two revision 1 repository none
restartFile fileType ONE_FILE saveCount 1
xMin 0 xMax 10 yMin 0 yMax 10 zMin 0 zMax 10
timeStep 0.001 time 4 ntimeSteps 4001 timeMax 4
Species 1
LinearViscoelasticSpecies id 0 density 2000 stiffness 1000 dissipation 2 a 1 b 2 c 3
Boundaries 1
LeesEdwardsBoundary id 0 left 0 right 10 down 0 up 10 shift 42 vel 1
Particles 3
SphericalParticle id 7 indSpecies 0 position 5 9.1 0 velocity 0 0 0 radius 1
SphericalParticle id 9 indSpecies 0 position 3 1 0 velocity 0 0 0 radius 1
SphericalParticle id 10 indSpecies 0 position 8 5 0 velocity 0 0 0 radius 1
Interactions 1
LinearViscoelasticInteraction particleIds 7 9 timeStamp 1 force 0 -3 0 torque 0 0 0
"""


def written(folder, text, name="g.csv"):
    (folder / name).write_text(text)
    return folder / name


def brute_force(position, radius, cell, reach):
    """Contacting pairs with their overlaps, from all images up to `reach` periods away."""
    found = []
    shifts = np.array(list(itertools.product(*(range(-n, n + 1) for n in reach)))) @ cell.T
    for a, b in itertools.combinations(range(len(radius)), 2):
        distance = np.linalg.norm(position[b] - position[a] + shifts, axis=1)
        found += [(a, b, radius[a] + radius[b] - d) for d in distance if d < radius[a] + radius[b]]
    return sorted(found)


@pytest.mark.parametrize("box", ["4", "4,12,0,0,4,0,0,0,4", "4,40,-8,0,4,4,0,0,4", "4,2,0,0,4,0,0,0,4"])
def test_a_box_is_reduced_before_it_is_judged(tmp_path, box):
    file, output = written(tmp_path, f"x,y,z,r\n{ROWS}"), str(tmp_path / "o.state.nc")
    assert main(["import", str(file), f"--box={box}", "--length-unit", "mm", "-o", output]) == 0
    state = lk.read_state(output)
    values = [float(value) for value in box.split(",")]
    cell = 1e-3 * (values[0] * np.eye(3) if len(values) == 1 else np.reshape(values, (3, 3)))
    grains = 1e-3 * np.loadtxt(ROWS.split(), delimiter=",")
    expected = brute_force(grains[:, :3], grains[:, 3], cell, (14, 3, 3))
    contacts = state.snapshot().contacts
    assert contacts.grain.tolist() == [[a, b] for a, b, _ in expected] and len(expected) >= 2
    np.testing.assert_allclose(contacts.overlap, [d for _, _, d in expected], atol=1e-15)
    assert main(["info", output]) == 0


@pytest.mark.parametrize("box", ["4,4,0.9", "4,0.3,4", "4,4,0,0,0.8,0,0,0,4"])
def test_a_box_narrower_than_a_grain_is_refused(tmp_path, box, capsys):
    file, output = written(tmp_path, f"x,y,z,r\n{ROWS}"), tmp_path / "o.state.nc"
    words = ["import", str(file), f"--box={box}", "--length-unit", "mm", "-o", str(output), "--accept"]
    assert main(words) == 2
    assert "a grain of 0.001 m in a box" in capsys.readouterr().err and not output.exists()


@pytest.mark.parametrize(
    "text, contacts, message",
    [
        ("1,1,1,0.5\n1,1,1.6,0.5\n3,3,3,0.5\n", None, "overlap by 40%"),
        ("1,1,1,0.5\n1,1,1.99,0.5\n3,3,3,0.5\n", "id1,id2,fn\n0,1,1\n0,2,1\n", "far apart"),
    ],
)
def test_nothing_is_written_that_labkit_then_refuses(tmp_path, text, contacts, message, capsys):
    """Even if the findings are accepted."""
    words = ["import", str(written(tmp_path, f"x,y,z,r\n{text}")), "--box=4", "--length-unit", "mm", "--accept"]
    if contacts:
        words += ["--contacts", str(written(tmp_path, contacts, "c.csv")), "--force-unit", "N", "--first-id", "0"]
        words += ["--force-sign", "compression"]
    assert main([*words, "-o", str(tmp_path / "o.state.nc")]) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "o.state.nc").exists()


def test_a_sphere_pack_of_a_sheared_cell_is_noticed(tmp_path, sheared):
    """Its header holds lengths only; the grains then overlap across the faces."""
    lengths = " ".join(map(str, np.linalg.norm(sheared.cell, axis=0).tolist()))
    rows = "\n".join(" ".join(map(str, row)) for row in np.column_stack([sheared.position, sheared.radius]).tolist())
    file = written(tmp_path, f"##PERIODIC:: {lengths}\n{rows}\n", "s.txt")
    found = read(file, length_unit="m")
    assert any("lengths of its cell only" in str(one) for one in found.findings)
    assert any("has the box lost its shear?" in str(one) for one in found.findings if one.serious)
    found = read(file, length_unit="m", box=sheared.cell)
    assert not [one for one in found.findings if one.serious]
    assert found.grain.tolist() == sheared.contact_grain.tolist()


BOX = "".join(f"0 4 {axis}lo {axis}hi\n" for axis in "xyz")
ATOMS = "1 {0} 1.0 2650 1 1 1\n2 {0} 1.0 2650 1 1 1.99\n3 {0} 1.0 2650 3 3 3\n"


@pytest.mark.parametrize(
    "first",
    ["Atoms of a sample, 3 grains", "2 atoms per cell, 3 in all", "Atoms", "2 atoms", "0 9 xlo xhi", "", "# Atoms"],
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_the_first_line_of_lammps_is_a_comment(tmp_path, first, end):
    text = f"{first}\n\n3 atoms\n1 atom types\n\n{BOX}\nAtoms # sphere\n\n{ATOMS.format(1)}"
    (tmp_path / "a.data").write_bytes(text.replace("\n", end).encode())
    found = read(tmp_path / "a.data", length_unit="mm")
    assert found.grain.tolist() == [[0, 1]] and len(found.radius) == 3
    np.testing.assert_allclose(found.cell, 4e-3 * np.eye(3))


def test_types_of_lammps_may_have_labels(tmp_path):
    labels = "Atom Type Labels\n\n1 sand\n2 gravel\n"
    text = f"by hand\n\n3 atoms\n2 atom types\n\n{BOX}\n{labels}\nAtoms # sphere\n\n{ATOMS.format('sand')}"
    found = read(written(tmp_path, text, "a.data"), length_unit="mm")
    assert found.grain.tolist() == [[0, 1]]
    other = text.replace("sand 1.0 2650 1 1 1\n", "sand wide 2650 1 1 1\n")
    with pytest.raises(lk.InputError, match="'wide' is not a number"):
        read(written(tmp_path, other, "b.data"), length_unit="mm")


def test_a_data_file_without_its_first_line_is_explained(tmp_path):
    text = f"3 atoms\n\n{BOX}\nAtoms # sphere\n\n{ATOMS.format(1)}"
    with pytest.raises(lk.InputError, match="takes its first line for a comment"):
        read(written(tmp_path, text, "a.data"), length_unit="mm", format="lammps_data")


@pytest.mark.parametrize("box, tilt", [("10", 2.0), ("10,2,0,0,10,0,0,0,10", 2.0), ("10,0,0,0,10,0,0,0,10.5", 2.0)])
def test_the_shift_of_lees_edwards_boundaries_is_kept(tmp_path, box, tilt):
    """Also if z is not periodic, so that the box must be given: 42 mod 10 = 2, and the grains touch, 1.9 apart."""
    file = written(tmp_path, MERCURY, "two.restart")
    found = read(file, length_unit="mm", force_unit="N", box=box)
    assert found.cell[0, 1] == pytest.approx(1e-3 * tilt)
    contacts = found.state(lk.Scene()).snapshot().contacts
    assert contacts.grain.tolist() == [[0, 1]] and contacts.overlap == pytest.approx([0.1e-3])
    assert found.normal_force == pytest.approx([3.0]) and contacts.normal[0] == pytest.approx([0.0, 1.0, 0.0])
    texts = " ".join(map(str, found.findings))
    assert ("sheared by 2 in x" in texts) or ("shift of 2 in x" in texts)
    assert "all grains have the same z: if they are discs" in texts
    assert "density 2000 (--density), stiffness 1000, dissipation 2, a 1, b 2: not used" in texts and "c 3" not in texts


def test_a_restart_with_all_boundaries_has_its_own_box_and_no_walls(tmp_path):
    periodic = "PeriodicBoundary id 1 normal 0 0 1 scaleFactor 1 distanceLeft 0 distanceRight 10 shift 0 0 10"
    wall = "LinearViscoelasticInteraction particleId 7 wallId 0 timeStamp 1 force 0 1 0 torque 0 0 0"
    text = MERCURY.replace("Boundaries 1", f"Boundaries 2\n{periodic}")
    text = text.replace("Interactions 1", f"Interactions 2\n{wall}")
    found = read(written(tmp_path, text, "two.restart"), length_unit="mm", force_unit="N")
    np.testing.assert_allclose(found.cell, 1e-3 * np.array([[10, 2, 0], [0, 10, 0], [0, 0, 10]]))
    assert "1 contacts with walls are left out" in map(str, found.findings) and len(found.grain) == 1


@pytest.mark.parametrize("version", ["2", "3", "4beta"])
def test_old_versions_of_mercury_are_named(tmp_path, version):
    file = written(tmp_path, f"restart_version {version}\nname chute\nxmin 0 xmax 1\nParticles 0\n", "old.restart")
    for given in ({}, {"format": "mercury"}):
        with pytest.raises(
            lk.InputError, match=f"is a restart file of a MercuryDPM before 0.11 .restart_version {version}.: write it"
        ):
            import_state(file, length_unit="m", **given)


@pytest.mark.parametrize("damage", [("radius 1", "radius"), (" position 5 9.1 0", ""), ("9.1", "high")])
def test_damage_is_told_in_words_of_labkit(tmp_path, damage):
    file = written(tmp_path, MERCURY.replace(*damage, 1), "two.restart")
    with pytest.raises(lk.InputError, match=r"lacks (radius and 1|position and 3) numbers|'high' is not a number"):
        read(file, length_unit="mm", force_unit="N", box="10")


def test_mercury_says_what_is_no_sphere_and_which_constants_are_friction(tmp_path):
    text = MERCURY.replace("SphericalParticle id 9", "SuperQuadricParticle id 9").replace(
        "stiffness", "slidingFriction"
    )
    file = written(tmp_path, text, "two.restart")
    said = " ".join(map(str, read(file, length_unit="mm", force_unit="N", box="10").findings))
    assert "SuperQuadricParticle of the file become spheres" in said and "(--friction)" in said
