"""A campaign as one lazy object; hundreds of runs are summarised without being loaded at once."""

import json
import shutil
import subprocess
import sys

import netCDF4
import numpy as np
import pytest
import xarray as xr

import labkit
from labkit.errors import InputError
from labkit.files.hashes import sha256_of_groups
from labkit.plugins.campaigns.collection import open_campaign
from tests.changed import changed, without
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

RUNS = 300


@pytest.fixture(scope="module")
def one(tmp_path_factory, labkit_command):
    """A run file with 120 grains and some records."""
    folder = tmp_path_factory.mktemp("one")
    words = ["--void-ratio", 0.606, "--step1-friction", 0.06, "--grains", 120, "--engine", "fused", "-o", "s.state.nc"]
    assert labkit_command("specimen", *words, cwd=folder).returncode == 0
    words = ["--strain", 0.01, "--rate", 40, "--snapshots", 1, "--engine", "fused", "-o", "r.run.nc"]
    done = labkit_command("run", "cv", "s.state.nc", *words, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "r.run.nc"


@pytest.fixture(scope="module")
def many(tmp_path_factory, one):
    """Folder of a synthetic campaign: copies with different seeds, and stresses that are multiples."""
    folder = tmp_path_factory.mktemp("many")
    (folder / "runs").mkdir()
    without(one, folder / "one.run.nc", ())  # its checkpoint, and space for more records
    for k in range(RUNS):
        file = folder / "runs" / f"cv-{k:04d}.run.nc"
        shutil.copy(folder / "one.run.nc", file)
        with changed(file) as run:
            run.seed = k
            run["stress"][:] = run["stress"][:] * (1 + k)
    yield folder
    shutil.rmtree(folder)


MEMORY = """
import json, pathlib, sys, time
import labkit, xarray
from labkit.plugins.campaigns.collection import open_campaign
def most():
    return int(pathlib.Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
open_campaign(sys.argv[2]).runs.summary()  # memory for one run
before, begin = most(), time.perf_counter()
campaign = open_campaign(sys.argv[1])
opened = time.perf_counter() - begin
table = campaign.runs.summary()
summarised = time.perf_counter() - begin - opened
grown = most() - before
print(json.dumps({"opened_s": opened, "summarised_s": summarised, "grown_MB": grown / 1e3,
                  "final": table["final_mean_stress"].values.tolist()}))
"""


def test_hundreds_of_runs_are_summarised_without_being_loaded(many, one):
    done = subprocess.run([sys.executable, "-c", MEMORY, many, one], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    final = np.array(found.pop("final"))
    np.testing.assert_allclose(final / final[0], np.arange(1, RUNS + 1))
    size = sum(file.stat().st_size for file in (many / "runs").iterdir()) / 1e6
    print(f"{RUNS} runs, {size:.0f} MB:", found)
    assert found["grown_MB"] < 0.3 * size


def test_it_is_lazy_and_labelled(many, one):
    campaign = open_campaign(many)
    assert campaign.sizes["run"] == RUNS and campaign["seed"].values.tolist() == list(range(RUNS))
    assert set(campaign["path"].values) == {"cv"} and (campaign["rate"] == 40.0).all()
    assert (campaign["specimen"] == "s.state.nc").all() and np.allclose(campaign["specimen_void_ratio"], 0.606)
    single = labkit.open_run(one)
    for file in (many / "runs").glob("cv-0[1-9]*"):
        file.rename(file.with_suffix(".away"))  # reading any file that is not selected fails
    try:
        some = campaign.isel(run=(campaign["seed"] < 3).values)
        multiples = np.array([1, 2, 3]).reshape(3, 1, 1, 1)
        np.testing.assert_allclose(some["stress"].values, single["stress"].values[None] * multiples)
        strain = some["strain"].values  # the recorded tensor, not the strain to reach
        np.testing.assert_allclose(strain, np.broadcast_to(single["strain"].values, strain.shape))
        assert strain.shape == some["stress"].shape and (campaign["target_strain"] == 0.01).all()
        zz = campaign["stress"].sel(run="cv-0002").isel(i=2, j=2, time=slice(2, 5))
        np.testing.assert_allclose(zz.values, 3 * single["stress"].values[2:5, 2, 2])
        assert campaign.runs.open("cv-0001").sizes["snapshot"] == single.sizes["snapshot"]
    finally:
        for file in (many / "runs").glob("*.away"):
            file.rename(file.with_suffix(".nc"))


def test_shorter_runs_are_padded_with_nan_and_the_accessor_is_that_of_a_run(one, tmp_path, labkit_command):
    words = ["--strain", 0.005, "--rate", 40, "--engine", "fused", "--snapshots", 0, "-o", tmp_path / "short.run.nc"]
    assert labkit_command("run", "cv", one.with_name("s.state.nc"), *words).returncode == 0
    shutil.copy(one, tmp_path / "long.run.nc")
    campaign = open_campaign(tmp_path)
    assert campaign["run"].values.tolist() == ["long", "short"]
    short = campaign["stress"].sel(run="short")
    records = int(campaign["records"].sel(run="short"))
    assert records < campaign.sizes["time"]
    assert np.isfinite(short[:records].values).all() and np.isnan(short[records:].values).all()
    table = campaign.runs.summary()
    assert table["strain_reached"].values == pytest.approx([0.01, 0.005], rel=1e-3)
    assert table["final_mean_stress"].attrs["units"] == "Pa"
    assert campaign["target_strain"].values == pytest.approx([0.01, 0.005])
    assert campaign["friction"].values == pytest.approx([0.4, 0.4]) and campaign["young_modulus"].attrs["units"] == "Pa"
    assert (campaign["law"] == "rolling_resistance").all() and (campaign["void_ratio"].dims == ("run", "time"))

    single = labkit.open_run(one)
    zz = campaign["stress"].sel(run="long", i="z", j="z")
    np.testing.assert_array_equal(zz.values, single["stress"].sel(i="z", j="z").values)
    for name in ("stress_ratio", "q", "strain", "friction_angle", "dilation_angle", "sff_error"):
        every = getattr(campaign.lab, name)()
        assert every.dims == ("run", "time") and every.attrs == getattr(single.lab, name)().attrs
        np.testing.assert_array_equal(every.sel(run="long").values, getattr(single.lab, name)().values)
        assert np.isnan(every.sel(run="short").values[-1]) and np.isfinite(every.sel(run="short").values[1])
    np.testing.assert_array_equal(campaign.sel(run="long").lab.q().values, single.lab.q().values)
    assert (campaign.lab.pore_pressure_ratio().max("time") > 0.0).all()
    with pytest.raises(labkit.InputError, match="open one of them"):
        campaign.lab.snapshot(0)


def test_a_summary_has_what_differs_and_numbers_with_a_meaning(two):
    runs = labkit.open_runs(str(two / "*.run.nc"))
    table = runs.runs.summary()
    assert set(table.coords) == {"run", "path", "target_strain", "records"}
    assert not any(bool(column.isnull().all()) for column in table.data_vars.values())
    assert {"seed", "engine"} <= set(runs.coords)  # the campaign has all parameters
    one = runs.isel(run=[0]).runs.summary()
    assert set(one.coords) == {"run", "path"} and "final_mean_stress" in one
    assert "cycles" not in table and "critical_M" not in table and "peak_stress_ratio" in table


def test_the_summary_has_angles_and_volumetric_strain_at_the_peak_and_at_the_end():
    folder = ROOT / "results/paper/runs"
    table = open_campaign(*(folder / f"{name}.run.nc" for name in ("cv-dense", "cr_500kPa-dense"))).runs.summary()
    drained, undrained = table.sel(run="cr_500kPa-dense"), table.sel(run="cv-dense")
    largest = float(drained["peak_stress_ratio"])
    sine = 3.0 * largest / (6.0 + largest)  # in triaxial compression
    assert float(drained["peak_friction_angle"]) == pytest.approx(np.degrees(np.arcsin(sine)), abs=0.3)
    assert 9.0 < float(drained["peak_dilation_angle"]) < 14.0 and abs(float(drained["final_dilation_angle"])) < 1.5
    assert abs(float(undrained["peak_dilation_angle"])) < 1e-6
    run = labkit.open_run(folder / "cr_500kPa-dense.run.nc")
    volume = np.log(float(run["volume"][-1] / run["volume"][0]))
    assert float(drained["final_volumetric_strain"]) == pytest.approx(-volume, rel=1e-4)
    assert table["final_friction_angle"].attrs["units"] == "degree"


def test_a_folder_without_runs_or_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="contains no run files: give a campaign folder or run files"):
        open_campaign(tmp_path)
    with pytest.raises(InputError, match="nowhere does not exist"):
        open_campaign(tmp_path / "nowhere")


@pytest.fixture(scope="module")
def two(tmp_path_factory, soft_specimen):
    """Two runs that differ in their strain, and so in their number of records."""
    folder = tmp_path_factory.mktemp("two")
    for name, strain in (("short", 0.004), ("long", 0.008)):
        path = labkit.paths.ConstantVolume(strain=strain, rate=100)
        labkit.run(soft_specimen, path, file=folder / f"{name}.run.nc", progress=False, record_strain=1e-3)
    return folder


def test_plain_xarray_selects_components_by_name(two):
    with xr.open_dataset(two / "long.run.nc") as plain, labkit.open_run(two / "long.run.nc") as run:
        for axes in ({"i": "z", "j": "z"}, {"i": "x", "j": "z"}):
            np.testing.assert_array_equal(plain["stress"].sel(axes).values, run["stress"].sel(axes).values)
        assert plain["i"].values.tolist() == ["x", "y", "z"]


def test_labels_are_no_data(two, tmp_path):
    file = shutil.copy(two / "long.run.nc", tmp_path / "old.run.nc")
    with netCDF4.Dataset(file) as run:
        assert run["i"].filters()["fletcher32"] and run["j"].filters()["fletcher32"]
        older = {path: {name: v[...].data for name, v in group.items()} for path, group in groups_without_labels(run)}
        assert sha256_of_groups(older.items()) == run.data_sha256  # of a file of an earlier version


def groups_without_labels(run):
    yield "/", {name: variable for name, variable in run.variables.items() if name not in ("i", "j")}
    for name in sorted(set(run.groups) - {"checkpoint"}):
        yield f"/{name}", run[name].variables


def test_many_run_files_are_one_dataset(two):
    files = [two / "short.run.nc", two / "long.run.nc"]
    runs = labkit.open_runs(files)
    assert runs["run"].values.tolist() == ["short", "long"] and runs["target_strain"].values.tolist() == [0.004, 0.008]
    assert "rate" not in runs.coords and "friction" not in runs.coords  # the same in both
    for name, file in zip(("short", "long"), files, strict=True):
        with labkit.open_run(file) as one:
            records = one.sizes["time"]
            np.testing.assert_array_equal(runs["stress"].sel(run=name).isel(time=slice(records)), one["stress"])
            assert np.isnan(runs["stress"].sel(run=name).isel(time=slice(records, None))).all()
            np.testing.assert_array_equal(runs.lab.q().sel(run=name).values[:records], one.lab.q().values)
    pattern = labkit.open_runs(str(two / "*.run.nc"))
    assert pattern["run"].values.tolist() == ["long", "short"]
    opened = labkit.open_runs([labkit.Run.open(file) for file in files])
    xr.testing.assert_identical(opened.load(), runs.load())


def test_the_target_of_a_run_is_its_last_record(two):
    """A run ends within a time step of its target; farther beyond, nothing is known."""
    runs = labkit.open_runs(str(two / "long.run.nc"))
    end = float(runs["axial_strain"][0, -1])
    common = runs.runs.interpolate([0.0, end + 2e-5, end + 5e-4])["stress"].values[0]
    np.testing.assert_allclose(common[1], runs["stress"].values[0, -1])
    assert np.isnan(common[2]).all()


def test_records_of_many_runs_are_put_on_common_strains(two):
    runs = labkit.open_runs(str(two / "*.run.nc")).sel(run=["short", "long"])
    strains = np.array([0.0, 0.0015, 0.004, 0.008])
    common = runs.runs.interpolate(strains)
    assert common["stress"].dims == ("run", "axial_strain", "i", "j") and common["target_strain"].dims == ("run",)
    with labkit.open_run(two / "long.run.nc") as one:
        at, stress = one["axial_strain"].values, one["stress"].sel(i="z", j="z").values
        expected = np.interp(strains, at, stress)
        np.testing.assert_allclose(common["stress"].sel(run="long", i="z", j="z"), expected, rtol=1e-12)
    assert np.isnan(common["stress"].sel(run="short", axial_strain=0.008)).all()
    assert np.isfinite(common["stress"].mean("run")).all()  # xarray leaves out the NaN
    with pytest.raises(InputError, match="turns back"):
        runs.runs.interpolate(strains, along="kinetic_energy")
    with pytest.raises(InputError, match="unknown"):
        runs.runs.interpolate(strains, along="axial")


@pytest.mark.parametrize("files", [[], "nothing/*.run.nc", [3], 3])
def test_anything_but_run_files_is_refused_in_one_line(files):
    with pytest.raises(InputError) as refused:
        labkit.open_runs(files)
    assert len(str(refused.value).splitlines()) == 1


def test_own_variables_of_types_that_a_file_defines_are_left_out(one, tmp_path):
    shutil.copy(one, tmp_path / "r.run.nc")
    with changed(tmp_path / "r.run.nc") as data:
        pair = data.createCompoundType(np.dtype([("a", "f8"), ("b", "i4")]), "pair")
        for name, kind in (("compound", pair), ("list", data.createVLType("i4", "list_t")), ("text", str)):
            data.createVariable(name, kind, ("time",))
        data.createVariable("choice", data.createEnumType("u1", "enum_t", {"no": 0, "yes": 1}), ("time",))
        data.createDimension("other", 2)
        data.createVariable("wide", "f8", ("time", "other"))
        data.createVariable("whole", "i4", ("time",))[:] = 3
    runs = labkit.open_runs(tmp_path / "r.run.nc").load()
    assert not {"compound", "list", "text", "choice", "wide"} & set(runs) and (runs["whole"] == 3.0).all()


def test_a_run_in_memory_has_no_file(soft_specimen):
    run = labkit.run(soft_specimen, labkit.paths.ConstantVolume(strain=0.002, rate=100), progress=False)
    with pytest.raises(InputError, match=r"file='r\.run\.nc'"):
        labkit.open_runs([run])


def test_a_name_that_exists_is_no_pattern(two, tmp_path):
    folder = tmp_path / "data[2026]"
    folder.mkdir()
    plain, bracketed = folder / "r1.run.nc", folder / "r[1].run.nc"
    shutil.copy(two / "short.run.nc", plain)
    shutil.copy(two / "long.run.nc", bracketed)
    assert labkit.open_runs(str(bracketed))["file"].values == [str(bracketed)]
    assert labkit.open_runs(str(folder / "r[0-9].run.nc"))["file"].values == [str(plain)]
    assert len(labkit.open_runs(str(folder / "*.run.nc"))["file"]) == 2
