"""Files of version 0.1.0 stay readable: the paper's runs in results/, and files without variables added later."""

import hashlib
import json
import shutil

import matplotlib.pyplot as plt
import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.grains.state import read_state
from labkit.io.schema import CONTACTS, ESSENTIAL, GRAINS, RECORD, STATE
from labkit.paths.registry import PATHS
from tests.changed import changed
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

RUNS = sorted((ROOT / "results/paper/runs").glob("*.run.nc"))
EARLIER = {"yade": "rolling_resistance", "paper": "spring_dashpot"}  # names of laws in version 0.1.0
OTHER = sorted(set(RECORD) - set(ESSENTIAL))


def without(old, new, names):
    """A copy of a run file without some variables, `name` or `group/name`, or without a group, `group/`."""
    with netCDF4.Dataset(old) as source, changed(new) as target:
        for group in (source, *source.groups.values()):
            prefix = "" if group is source else f"{group.name}/"
            if prefix in names or prefix == "checkpoint/":
                continue
            into = target.createGroup(group.name) if prefix else target
            into.setncatts({name: group.getncattr(name) for name in group.ncattrs()})
            for name, dimension in group.dimensions.items():
                into.createDimension(name, len(dimension))
            for name, variable in group.variables.items():
                if prefix + name not in names:
                    made = into.createVariable(name, variable.dtype, variable.dimensions)
                    made.setncatts({key: variable.getncattr(key) for key in variable.ncattrs()})
                    made[...] = variable[...]
    return new


def test_all_runs_of_the_paper_are_in_the_repository():
    assert len(RUNS) == 51


@pytest.mark.parametrize("file", RUNS, ids=lambda file: file.name.removesuffix(".run.nc"))
def test_a_run_of_version_0_1_0_is_readable(file):
    with netCDF4.Dataset(file) as dataset:
        assert dataset.labkit_version == "0.1.0"
        law, known = json.loads(dataset.scene)["law"], json.loads(dataset.path_parameters)
        stress = dataset["stress"][:].filled()
    run = lk.Run.open(file)
    assert run.scene.law == EARLIER[law] and run.scene.contact_law.name == EARLIER[law]
    assert run.complete and run.engine in ("fused", "yade") and run.steps > 0 and run.threads is None
    assert run.path.name in PATHS and (run.path.rate, run.path.strain) == (known["rate"], known["strain"])
    assert getattr(run.path, "pressure", None) == known.get("pressure")
    np.testing.assert_array_equal(run.data["stress"], stress)
    assert all(np.isfinite(run.data[name]).all() for name in RECORD)
    for snapshot in run.snapshots:  # three files contain some snapshots in single precision
        at = run.data.isel(time=int(run.data["record"][snapshot.number]))
        np.testing.assert_allclose(lk.love_stress(snapshot), at["stress"], rtol=1e-6, atol=1.0)
        np.testing.assert_allclose(lk.sff_stress(snapshot), at["stress_sff"], rtol=1e-6, atol=1.0)
    assert {limit.name for limit in run.exceeded} <= {"inertial number", "mean overlap", "mean stress"}
    found = lk.verify(run)
    held = [finding for finding in found if finding.name.startswith("held:")]
    assert held and all(finding.holds for finding in held), [str(finding) for finding in held]
    stored = STORED if len(run.snapshots) else "C0"
    assert all(f.holds for f in found if f.decides and "C0" not in f.name and not f.name.startswith(stored))
    run.data.close()


STORED = "stored stress against its contacts"
SOME = [ROOT / f"results/paper/runs/{name}.run.nc" for name in ("cv-dense", "cr_500kPa-loose", "cyclic-cyclic_dense")]


def test_commands_read_files_of_version_0_1_0(tmp_path, labkit_command):
    """The contacts of the first file are in single precision, which verify reports with exit code 1."""
    done = labkit_command("verify", *SOME, "-o", "v.png", "--csv", "v.csv", cwd=tmp_path)
    assert done.returncode == 1 and done.stderr == "", done.stderr
    failed = [line for line in done.stdout.splitlines() if line.endswith("FAILED")]
    assert len(failed) == 1 and failed[0].startswith(f"{STORED}, 3 snapshots")
    assert float(failed[0].split()[-4]) < 1e-6
    assert done.stdout.count("held: ") == 1 + 2 + 2
    done = labkit_command("critical", *SOME, "-o", "c.png", "--csv", "c.csv", cwd=tmp_path)
    assert done.returncode == 0 and "cv-dense" in done.stdout, done.stderr
    assert "left out: cyclic-cyclic_dense: path cyclic_cp " in done.stdout
    for figure, more in (("test", []), ("shares", []), ("records", ["--variable", "friction_loss"])):
        done = labkit_command("figure", figure, SOME[0], *more, "-o", f"{figure}.png", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    done = labkit_command("figure", "groups", SOME[1], "-o", "g.png", cwd=tmp_path)
    assert done.returncode == 2 and "cr_500kPa-loose.run.nc" in done.stderr
    done = labkit_command("watch", "--once", SOME[0], cwd=tmp_path)
    assert done.returncode == 0 and "axial strain" in done.stdout, done.stderr
    done = labkit_command("info", SOME[0], "--check", cwd=tmp_path)
    assert "same" in done.stdout and "differs" not in done.stdout, done.stderr
    pictures = ("v.png", "c.png", "test.png", "shares.png", "records.png")
    assert {name.name for name in tmp_path.iterdir()} == {*pictures, "v.csv", "c.csv"} | {
        f"{name}.csv.provenance.json" for name in "vc"
    }
    assert all((tmp_path / name).read_bytes()[:4] == b"\x89PNG" for name in pictures)


def test_critical_states_equal_the_published_values():
    """The same files give the same table as results/paper/critical_states.csv."""
    import pandas

    published = pandas.read_csv(ROOT / "results/paper/critical_states.csv").set_index("run")
    shear = {file.name.removesuffix(".run.nc"): lk.open_run(file) for file in RUNS}
    shear = {name: run for name, run in shear.items() if run.attrs["path"] in ("cv", "cr", "cp")}
    found = lk.critical_states(shear).set_index("run")
    common = found.index.intersection(published.index)
    assert len(common) > 10
    for column in found.columns.intersection(published.columns).difference(["path"]):
        np.testing.assert_allclose(found.loc[common, column], published.loc[common, column], rtol=2e-4, err_msg=column)


# --- files with missing variables --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(run_file):
    """Verdicts on the whole file."""
    return [finding.holds for finding in lk.verify(run_file) if finding.decides and "C0" not in finding.name]


@pytest.mark.parametrize("name", OTHER)
def test_a_missing_variable_reads_as_nan(name, run_file, whole, tmp_path):
    run = lk.Run.open(without(run_file, tmp_path / "r.run.nc", {name}))
    lacking = run.data[name]
    assert lacking.dims == RECORD[name].dimensions and np.isnan(lacking.values).all()
    assert (lacking.attrs["units"], lacking.attrs["long_name"]) == (RECORD[name].units, RECORD[name].long_name)
    assert all(np.isfinite(run.data[other]).all() for other in RECORD if other != name)
    assert run.complete and isinstance(run.exceeded, tuple) and len(run.snapshots) == 5 + 1
    np.testing.assert_allclose(lk.love_stress(run.snapshots[-1]), run.data["stress"][-1], rtol=1e-12, atol=1e-6)
    found = [finding for finding in lk.verify(run) if finding.decides and "C0" not in finding.name]
    judged = [finding for finding in found if name != "stress_sff" or "against its contacts" not in finding.name]
    assert all(whole) and all(finding.holds for finding in judged), [str(finding) for finding in found]
    assert lk.critical_states({"r": run.data})["M"].notna().all()
    assert run.plot("test") is not None
    plt.close("all")


def test_a_file_of_another_program_with_only_the_essential_variables(run_file, tmp_path, labkit_command):
    without(run_file, tmp_path / "r.run.nc", set(OTHER))
    for words in (
        ["verify", "r.run.nc", "-o", "v.png"],
        ["critical", "r.run.nc", "--min-strain", "0.01"],
        ["watch", "--once", "r.run.nc"],
        ["figure", "test", "r.run.nc"],
        ["figure", "contacts", "r.run.nc"],
        ["picture", "r.run.nc"],
        ["info", "r.run.nc"],
    ):
        done = labkit_command(*words, cwd=tmp_path)
        assert done.returncode == (1 if words[0] == "verify" else 0), (words, done.stderr)
        assert done.stderr == ""


LACKING = [
    *ESSENTIAL,
    *(f"contacts/{name}" for name in CONTACTS),
    *(f"grains/{name}" for name in GRAINS),
    "contacts/",
    "grains/",
]


@pytest.mark.parametrize("name", LACKING)
def test_a_file_without_an_essential_variable_is_refused(name, run_file, tmp_path):
    file = without(run_file, tmp_path / "r.run.nc", {name})
    lacking = {"contacts/": "record", "grains/": "radius"}.get(name, name.split("/")[-1])
    for read in (lk.open_run, lk.verify, lk.Run.open):
        with pytest.raises(lk.InputError) as refused:
            read(file)
        assert str(refused.value) == f"{file} is damaged ({lacking} is missing): repeat the run"


def test_a_damaged_file_is_refused_in_one_line(run_file, tmp_path, labkit_command):
    without(run_file, tmp_path / "stress.run.nc", {"stress"})
    shutil.copy(run_file, tmp_path / "scene.run.nc")
    with changed(tmp_path / "scene.run.nc") as run:
        del run.scene
    shutil.copy(run_file, tmp_path / "law.run.nc")
    with changed(tmp_path / "law.run.nc") as run:
        run.scene = run.scene.replace("rolling_resistance", "hertz")
    before = sorted(tmp_path.iterdir())
    for file, word in (("stress", "stress"), ("scene", "scene"), ("law", "'hertz'")):
        for command in ("verify", "critical", "picture", *(["watch"] if file != "law" else [])):  # watch needs no law
            words = [command, f"{file}.run.nc", *(["--once"] if command == "watch" else [])]
            done = labkit_command(*words, cwd=tmp_path)
            assert done.returncode == 2 and word in done.stderr.partition(f"labkit: {file}.run.nc")[2], (
                words,
                done.stderr,
            )
            assert len(done.stderr.strip().splitlines()) == 1 and sorted(tmp_path.iterdir()) == before


# --- specimens and unfinished runs of version 0.1.0 ---------------------------------------------------------------


def as_of_version_0_1_0(file):
    """Replaces the names of laws and the recipe in a file by those that version 0.1.0 wrote."""
    with changed(file) as dataset:
        scene = dataset.scene
        for earlier, name in EARLIER.items():
            scene = scene.replace(f'"{name}"', f'"{earlier}"')
        dataset.scene = scene
        recipe = json.loads(dataset.recipe)
        made = lk.Recipe(**recipe)
        recipe = {name: recipe[name] for name in ("void_ratio", "step1_friction", "step1_rolling_friction")}
        dataset.recipe = json.dumps({**recipe, "side": made.side_of(lk.Scene.from_json(scene)), "seed": made.seed})


def digest(state, scene):
    """Hash that identifies a specimen in a run file: SHA-256 of the scene as JSON and of the arrays."""
    sha256 = hashlib.sha256(scene.encode())
    for name in STATE:
        sha256.update(np.ascontiguousarray(getattr(state, name)).tobytes())
    return sha256.hexdigest()


@pytest.mark.parametrize("law", EARLIER)
def test_a_specimen_and_a_run_of_version_0_1_0_are_recognised(law, tmp_path, labkit_command):
    words = ["--void-ratio", 0.67, "--grains", 120, "--engine", "fused", "--law", law, "-o", "s.state.nc"]
    run = [
        "run",
        "cp",
        "s.state.nc",
        "--pressure",
        0.5e6,
        "--strain",
        0.01,
        "--rate",
        40,
        "--snapshots",
        1,
        "--engine",
        "fused",
        "-o",
        "r.run.nc",
    ]
    for command in (["specimen", *words], run):
        done = labkit_command(*command, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    for name in ("s.state.nc", "r.run.nc"):
        as_of_version_0_1_0(tmp_path / name)
    state = read_state(tmp_path / "s.state.nc")
    assert state.scene.law == EARLIER[law]
    with changed(tmp_path / "r.run.nc") as dataset:
        assert json.loads(dataset.scene)["law"] == law
        known = state.scene.identity()
        assert dataset.specimen == digest(state, json.dumps(known))
        dataset.specimen = digest(state, json.dumps(known | {"law": law}))
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    for command in (["specimen", *words], run):
        done = labkit_command(*command, cwd=tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before
    other = ["specimen", *words]
    other[other.index(0.67)] = 0.66
    done = labkit_command(*other, cwd=tmp_path)
    assert done.returncode == 0 and (tmp_path / "s.state.nc").read_bytes() != before[tmp_path / "s.state.nc"]
    done = labkit_command(*run, cwd=tmp_path)
    assert done.returncode == 2 and "r.run.nc was started with another specimen" in done.stderr
