"""Older files stay readable: runs of the paper, interrupted runs of version 0.2, and files that lack variables."""

import gzip
import json
from pathlib import Path

import matplotlib.pyplot as plt
import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.files.schema import CONTACTS, ESSENTIAL, GRAINS, RECORD
from labkit.grains.scene import FIRST_NAMES
from labkit.paths.registry import PATHS
from tests.changed import without
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

RUNS = sorted((ROOT / "results/paper/runs").glob("*.run.nc"))
OF_0_2 = Path(__file__).with_name("version_0_2")
ENDS = json.loads((OF_0_2 / "ends.json").read_text())
OTHER = sorted(set(RECORD) - set(ESSENTIAL))


@pytest.mark.parametrize("name", ["cv-dense", "cr_500kPa-loose", "cyclic-cyclic_dense", "share_cp-yade"])
def test_a_stored_run_of_the_paper_is_readable(name):
    file = ROOT / f"results/paper/runs/{name}.run.nc"
    with netCDF4.Dataset(file) as dataset:
        law, known = json.loads(dataset.scene)["law"], json.loads(dataset.path_parameters)
        stress = dataset["stress"][:].filled()
    run = lk.Run.open(file)
    assert run.scene.law == run.scene.contact_law.name == FIRST_NAMES[law]
    assert run.complete and run.engine in ("fused", "yade") and run.steps > 0 and run.threads is None
    assert run.path.name in PATHS and (run.path.rate, run.path.strain) == (known["rate"], known["strain"])
    assert getattr(run.path, "pressure", None) == known.get("pressure")
    np.testing.assert_array_equal(run.data["stress"], stress)
    assert all(np.isfinite(run.data[name]).all() for name in RECORD)
    assert {limit.name for limit in run.exceeded} <= {"inertial number", "mean overlap", "mean stress"}
    found = lk.verify(run)
    held = [finding for finding in found if finding.name.startswith("held:")]
    assert held and all(finding.holds for finding in held), [str(finding) for finding in held]
    assert all(finding.holds for finding in found if finding.decides and "equation" not in finding.name)
    run.data.close()


def test_critical_states_equal_the_published_values():
    """All stored runs open, and give the same table as results/paper/critical_states.csv."""
    import pandas

    assert len(RUNS) == 51
    published = pandas.read_csv(ROOT / "results/paper/critical_states.csv").set_index("run")
    shear = {file.name.removesuffix(".run.nc"): lk.open_run(file) for file in RUNS}
    shear = {name: run for name, run in shear.items() if run.attrs["path"] in ("cv", "cr", "cp")}
    found = lk.critical_states(shear).set_index("run")
    common = found.index.intersection(published.index)
    assert len(common) > 10
    for column in found.columns.intersection(published.columns).difference(["path"]):
        np.testing.assert_allclose(found.loc[common, column], published.loc[common, column], rtol=2e-4, err_msg=column)


def unpacked(name, folder):
    """A file of version 0.2 in a folder."""
    file = folder / name
    file.write_bytes(gzip.decompress((OF_0_2 / f"{name}.gz").read_bytes()))
    return file


@pytest.mark.parametrize("name", ENDS)
def test_a_killed_run_of_version_0_2_is_resumed(tmp_path, name):
    """It ends as version 0.2 would have ended it."""
    state, file = lk.read_state(unpacked("s.state.nc", tmp_path)), unpacked(f"{name}.run.nc", tmp_path)
    begun = lk.Run.open(file)
    with begun.data:
        first = begun.data["stress"].values
    assert not begun.complete and len(first) < ENDS[name]["records"] and begun.path.name == name
    run = lk.run(state, begun.path, file=file, progress=False, record_strain=5e-4, snapshots=2, save_every=1)
    assert run.complete and len(run.data["stress"]) == ENDS[name]["records"]
    np.testing.assert_array_equal(run.data["stress"][: len(first)], first)
    for variable in ("stress", "strain"):  # another processor rounds differently
        expected = np.array(ENDS[name][variable])
        np.testing.assert_allclose(run.data[variable][-1], expected, atol=1e-4 * np.abs(expected).max())


# --- files with missing variables --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(run_file):
    """Verdicts on the whole file."""
    return [finding.holds for finding in lk.verify(run_file) if finding.decides and "equation" not in finding.name]


@pytest.mark.parametrize("name", OTHER)
def test_a_missing_variable_reads_as_nan(name, run_file, whole, tmp_path):
    run = lk.Run.open(without(run_file, tmp_path / "r.run.nc", {name}))
    lacking = run.data[name]
    assert lacking.dims == RECORD[name].dimensions and np.isnan(lacking.values).all()
    assert (lacking.attrs["units"], lacking.attrs["long_name"]) == (RECORD[name].units, RECORD[name].long_name)
    assert all(np.isfinite(run.data[other]).all() for other in RECORD if other != name)
    assert run.complete and isinstance(run.exceeded, tuple) and len(run.snapshots) == 5 + 1
    np.testing.assert_allclose(lk.love_stress(run.snapshots[-1]), run.data["stress"][-1], rtol=1e-12, atol=1e-6)
    found = [finding for finding in lk.verify(run) if finding.decides and "equation" not in finding.name]
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
