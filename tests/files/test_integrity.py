"""Damaged, changed and impossible files: each is refused in one sentence before anything is computed from it."""

import json
import random
import re
import shutil

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.files.hashes import data_sha256
from labkit.files.netcdf import extend_netcdf, name_damage
from labkit.grains.state_file import read_state
from tests.changed import changed

pytestmark = pytest.mark.slow

FLIPS = 60  # damaged files of each kind


@pytest.fixture(scope="module")
def unfinished(run_file, tmp_path_factory):
    """A run file as a killed process leaves it: without data_sha256."""
    file = tmp_path_factory.mktemp("unfinished") / "r.run.nc"
    shutil.copy(run_file, file)
    with changed(file) as dataset:
        dataset.complete = np.int32(0)
        del dataset.data_sha256
    return file


def flipped(content, chance):
    """The content with one to three bytes changed, or a block of zeros, or a part missing."""
    damaged = bytearray(content)
    kind = chance.randrange(4)
    if kind == 0:
        at = chance.randrange(len(damaged))
        damaged[at : at + 512] = bytes(512)
    elif kind == 1:
        del damaged[chance.randrange(len(damaged)) :]
    if bytes(damaged) == content or kind > 1:
        for at in (chance.randrange(len(content)) for _ in range(chance.randint(1, 3))):
            damaged[at] ^= 1 << chance.randrange(8)
    return bytes(damaged)


def contents(file):
    """All attributes and values in a file, and the State in it."""
    state = read_state(file)
    with name_damage(file), netCDF4.Dataset(file) as dataset:
        values = {f"{group.path}/{name}": variable[...].tobytes() for group in (dataset, *dataset.groups.values())
                  for name, variable in group.variables.items()}  # fmt: skip
        return values, {name: str(dataset.getncattr(name)) for name in dataset.ncattrs()}, state.number_of_grains


@pytest.mark.parametrize("name", ["specimen_file", "run_file", "unfinished"])
def test_no_damaged_byte_is_believed(name, request, tmp_path):
    """HDF5's own checksums refuse it, unless it is in no value and no attribute."""
    good, chance = request.getfixturevalue(name), random.Random(name)
    file, expected, refused = tmp_path / "damaged.nc", contents(good), 0
    for _ in range(FLIPS):
        file.write_bytes(flipped(good.read_bytes(), chance))
        try:
            assert contents(file) == expected
        except lk.InputError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1
    assert refused > FLIPS / 4


@pytest.mark.parametrize("at, length", [(16, 4080), (16, 64), (64, 64), (152, 512)])
def test_damage_of_the_references_between_variables_does_not_hang(at, length, specimen_file, tmp_path, labkit_command):
    """HDF5 has no checksum for its global heap, and searches it without end if a length in it is 0."""
    damaged, file = bytearray(specimen_file.read_bytes()), tmp_path / "damaged.state.nc"
    at += damaged.index(b"GCOL")
    damaged[at : at + length] = bytes(length)
    file.write_bytes(damaged)
    for words in (("info", file), ("run", "cv", file, "--strain", 0.001, "-o", tmp_path / "r.run.nc")):
        done = labkit_command(*words)  # which does not wait for ever
        assert done.returncode == 2 and done.stderr.count("\n") == 1


def test_written_files_have_checksums(specimen_file, run_file, unfinished):
    for file in (specimen_file, run_file, unfinished):
        with netCDF4.Dataset(file) as dataset:
            for group in (dataset, *dataset.groups.values()):
                assert all(variable.filters()["fletcher32"] for variable in group.variables.values())


def test_a_change_by_another_program_is_found(run_file, tmp_path, labkit_command):
    copy = shutil.copy(run_file, tmp_path / "r.run.nc")
    with netCDF4.Dataset(copy, "a") as dataset:
        dataset["stress"][-1] *= 1.01
    assert labkit_command("info", copy).returncode == 0
    done = labkit_command("info", copy, "--check")
    assert done.returncode == 1 and re.search(r"the data of this file +differs", done.stdout)


@pytest.mark.parametrize("complete", [False, True])
def test_a_file_with_the_seal_of_earlier_versions_goes_on(complete, specimen_file, unfinished, run_file, tmp_path):
    """They ended with a line of text, and said so in an attribute."""
    file = shutil.copy(run_file if complete else unfinished, tmp_path / "r.run.nc")
    with netCDF4.Dataset(file, "a") as dataset:
        dataset.seal = "the last line of this file is the SHA-256 of all bytes before it"
    with open(file, "ab") as handle:
        handle.write(b"\nlabkit sha256 " + b"0" * 64 + b"\n")
    lk.open_run(file).close()
    with extend_netcdf(file, 1000) as dataset:
        dataset.complete = np.int32(1)
    with netCDF4.Dataset(file) as dataset, netCDF4.Dataset(run_file) as whole:
        assert "seal" not in dataset.ncattrs() and dataset.data_sha256 == whole.data_sha256


COMMANDS = {
    "verify": ["verify", "FILE"],
    "critical": ["critical", "FILE"],
    "figure": ["figure", "contacts", "FILE"],
    "picture": ["picture", "FILE"],
    "paraview": ["paraview", "FILE"],
    "calibrate": ["calibrate", "FILE"],
    "export": ["export", "FILE"],
    "info": ["info", "FILE", "--check"],
    "grading": ["grading", "FILE"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_refuses_a_damaged_run_in_one_line(name, run_file, tmp_path, labkit_command):
    content = bytearray(run_file.read_bytes())
    content[content.index(b'"friction"') + 1] ^= 1
    (tmp_path / "r.run.nc").write_bytes(content)
    words = [word.replace("FILE", "r.run.nc") for word in COMMANDS[name]]
    done = labkit_command(*words, cwd=tmp_path)
    assert done.returncode == 2 and "r.run.nc" in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["r.run.nc"]


def test_an_unreadable_chunk_is_damage(run_file, tmp_path, labkit_command):
    """The checksum of HDF5 finds it when the values are read."""
    copy = tmp_path / "r.run.nc"
    shutil.copy(run_file, copy)
    with netCDF4.Dataset(copy) as dataset:
        volume = dataset["volume"][:].tobytes()
    content = bytearray(copy.read_bytes())
    content[content.index(volume[:64]) + 3] ^= 1  # records are not compressed
    copy.write_bytes(content)
    with pytest.raises(lk.InputError, match=r"r\.run\.nc is damaged"):
        lk.open_run(copy).load()
    done = labkit_command("verify", copy)
    assert done.returncode == 2 and "r.run.nc is damaged" in done.stderr and done.stderr.count("\n") == 1, done.stderr


# --- impossible values, with a hash that is right -------------------------------------------------------------------


def put(name, index, value):
    def change(dataset):
        dataset[name][index] = value

    return change


def attribute(name, value):
    def change(dataset):
        dataset.setncattr(name, value)

    return change


def scene(name, value):
    def change(dataset):
        dataset.scene = json.dumps({**json.loads(dataset.scene), name: value})

    return change


STATES = {
    "a radius of 1e20 m": (put("radius", 0, 1e20), "radius "),
    "a fill value": (put("velocity", (0, 0), netCDF4.default_fillvals["f8"]), "velocity contains values above 1e\\+30"),
    "NaN": (put("tangential_force", (0, 0), np.nan), "tangential_force contains NaN"),
    "a grain far away": (put("position", 0, 1e3), "cell lengths from the periodic cell"),
    "radii times 1.3": (lambda d: put("radius", slice(None), d["radius"][:] * 1.3)(d), "overlap by"),
    "a left-handed cell": (lambda d: put("cell", slice(None), d["cell"][:, [1, 0, 2]])(d), "left-handed"),
    "a narrow cell": (put("cell", (2, 2), 1e-5), "narrower than its largest grain"),
    "a cell of NaN": (put("cell", (0, 0), np.nan), "cell "),
    "text for the step": (attribute("step", "seven"), "the attribute step is not a whole number"),
    "a negative time step": (attribute("time_step", -1.0), "the attribute time_step is not a time"),
    "a scene that is a list": (attribute("scene", "[]"), "the attribute scene is not a JSON object"),
    "planar as text": (scene("planar", "no"), "planar"),
    "true for a number": (scene("friction", True), "friction"),
    "a parameter that does not exist": (scene("colour", 1), "colour"),
    "a ledger of text": (attribute("ledger", "none"), "the attribute ledger is not at least five energies"),
}


@pytest.mark.parametrize("kind", ["f4", "i8", "S1"])
def test_a_state_in_another_type_is_refused(kind, specimen_file, tmp_path):
    file = tmp_path / "s.state.nc"
    with netCDF4.Dataset(specimen_file) as old, changed(file) as new:
        new.setncatts({name: old.getncattr(name) for name in old.ncattrs()})
        for name, dimension in old.dimensions.items():
            new.createDimension(name, len(dimension))
        for name, variable in old.variables.items():
            other = kind if name in ("radius", "contact_grain") and kind != "f4" else "f4" if name == "radius" else None
            made = new.createVariable(name, other or variable.dtype, variable.dimensions)
            if kind != "S1" or not other:
                made[...] = variable[...]
    with pytest.raises(lk.InputError, match=r"radius has the type"):
        read_state(file)


RUNS = {
    "a negative volume of the cell": (put("cell", (0, 0, 0), -1e-3), "a cell has no volume"),
    "a stress that was never recorded": (put("stress", -1, netCDF4.default_fillvals["f8"]), "stress "),
    "more contacts than rows": (put("contacts/row_size", 0, 10**6), "row_size counts"),
    "a record that does not exist": (put("contacts/record", -1, 10**6), "contacts/record does not list"),
    "a negative radius": (put("grains/radius", 0, -1.0), "grains/radius "),
    "complete as text": (attribute("complete", "yes"), "the attribute complete is not 0 or 1"),
    "no scene": (lambda d: d.delncattr("scene"), "scene"),
    "an unknown law": (scene("law", "hertz"), "'hertz'"),
    "parameters that are not JSON": (attribute("path_parameters", "{"), "path_parameters is not a JSON object"),
}


IMPOSSIBLE = [("specimen_file", read_state, *one) for one in STATES.values()]
IMPOSSIBLE += [("run_file", lk.open_run, *one) for one in RUNS.values()]


@pytest.mark.parametrize(("name", "read", "change", "message"), IMPOSSIBLE, ids=[*STATES, *RUNS])
def test_impossible_values_are_refused(name, read, change, message, request, tmp_path):
    file = shutil.copy(request.getfixturevalue(name), tmp_path / "f.nc")
    with changed(file) as dataset:
        change(dataset)
    with pytest.raises(lk.InputError, match=rf"f\.nc.*{message}") as refused:
        read(file)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name, value", [("contact_grain", 10**6), ("normal", 2.0), ("normal_force", np.nan)])
def test_impossible_contacts_are_refused_when_a_snapshot_is_read(name, value, run_file, tmp_path):
    file = tmp_path / "r.run.nc"
    shutil.copy(run_file, file)
    with changed(file) as dataset:
        dataset["contacts"][name][0] = value
    run = lk.Run.open(file)
    assert len(run.snapshots[-1].contacts) > 0
    with pytest.raises(lk.InputError, match=rf"r\.run\.nc .*{name}.* snapshot 0"):
        run.snapshots[0]


def test_only_data_enter_their_hash(run_file, tmp_path):
    """data_sha256 is a contract."""
    copy = tmp_path / "r.run.nc"
    shutil.copy(run_file, copy)
    with netCDF4.Dataset(copy, "a") as dataset:
        stored = dataset.data_sha256
        dataset.title = "another title"
        assert data_sha256(dataset) == stored


@pytest.mark.filterwarnings("ignore:invalid scale_factor")  # of the netCDF library, when the test writes the file
@pytest.mark.parametrize("command", ["info", "verify", "figure test", "export"])
@pytest.mark.parametrize("place", ["stress", "volume", "grains/radius"])
def test_a_text_in_place_of_a_factor_is_refused(command, place, run_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(run_file, "r.run.nc")
    with changed("r.run.nc") as dataset:
        dataset[place].setncattr("scale_factor" if place != "volume" else "add_offset", "two")
    assert main([*command.split(), "r.run.nc"]) == 2
    assert f"of {place.split('/')[-1]} is not a number" in (said := capsys.readouterr().err)
    assert said.count("\n") == 1


@pytest.mark.filterwarnings("ignore:invalid scale_factor")
def test_an_own_variable_with_a_text_as_factor_is_refused(specimen_file, tmp_path):
    shutil.copy(specimen_file, tmp_path / "s.state.nc")
    with changed(tmp_path / "s.state.nc") as dataset:
        dataset.createVariable("own", "f8").scale_factor = "two"
    with pytest.raises(lk.InputError, match="scale_factor of own is not a number"):
        lk.read_state(tmp_path / "s.state.nc")
