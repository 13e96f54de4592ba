"""A CV test in YADE: the run file, its physics, and the accessor."""

import netCDF4
import numpy as np
import pytest

import labkit
import labkit as lk
from labkit.micro.cells import widths
from labkit.micro.stress import relative_error
from labkit.records.limits import exceeded_in

pytestmark = pytest.mark.slow


@pytest.fixture
def run(run_file):
    return labkit.open_run(run_file)


def test_a_run_file_has_the_documented_names_units_and_attributes(run_file):
    root = (
        "axial_strain strain cell volume stress stress_sff void_ratio void_ratio_nominal coordination_number "
        "contact_anisotropy mean_normalised_force normal_force_anisotropy mobilisation inertial_number "
        "overlap_ratio rattler_fraction kinetic_energy unbalanced_force"
    ).split()
    contacts = ("record row_size contact_grain normal overlap normal_force tangential_force rolling_moment").split()
    with netCDF4.Dataset(run_file) as dataset:
        assert set(root) <= set(dataset.variables)
        assert set(contacts) == set(dataset["contacts"].variables)
        assert set(dataset["grains"].variables) == {"radius", "position"}
        for group in (dataset, dataset["contacts"], dataset["grains"]):
            assert all(v.units and v.long_name for v in group.variables.values())
        names = (
            "scene time time_step step seed engine engine_version labkit_version history path path_parameters "
            "complete wall_time steps"
        ).split()
        assert set(names) <= set(dataset.ncattrs())
        assert dataset.getncattr("path") == "cv" and dataset.complete == 1 and dataset.wall_time > 0
        assert dataset["contacts"]["row_size"][:].sum() == len(dataset["contacts"].dimensions["contact"])


def test_cv_keeps_the_volume_and_reaches_the_strain(run):
    volume = run["volume"].values
    assert np.abs(volume / volume[0] - 1).max() < 1e-10
    strain = run["axial_strain"].values
    assert np.isclose(strain[-1], 0.02, atol=1e-5) and abs(strain[0]) < 1e-15
    np.testing.assert_allclose(np.diff(strain)[:-1], 1e-3, rtol=1e-2)
    np.testing.assert_allclose(run["strain"][:, 0, 0], -strain / 2, atol=1e-12)


def test_stored_stresses_are_recomputed_from_stored_contacts(run):
    assert relative_error(run.lab.love_stress(), run.lab.at_snapshots("stress")).max() < 1e-12
    assert relative_error(run.lab.sff_stress(), run.lab.at_snapshots("stress_sff")).max() < 1e-12
    by_volume = run.lab.sff_stress_by_volume()
    assert relative_error(by_volume, run.lab.at_snapshots("stress_sff_by_volume")).max() < 1e-12
    Lambda = [lk.micro.statistics_by_volume(snapshot).mean_normalised_force for snapshot in run.lab.snapshots()]
    np.testing.assert_allclose(run.lab.at_snapshots("mean_normalised_force_by_volume"), Lambda, rtol=1e-12)
    statistics = run.lab.statistics()
    np.testing.assert_allclose(
        statistics["mean_normalised_force"], run.lab.at_snapshots("mean_normalised_force"), rtol=1e-12
    )


def test_the_accessor_returns_labelled_data(run):
    love = run.lab.love_stress()
    assert love.dims == ("snapshot", "i", "j") and love.attrs["units"] == "Pa"
    assert "axial_strain" in love.coords
    assert run["stress"].dims == ("time", "i", "j") and run["stress"].attrs["units"] == "Pa"
    one = run.lab.contacts(2)
    assert one.sizes["contact"] == int(run["row_size"][2])
    np.testing.assert_allclose(np.linalg.norm(one["normal"], axis=1), 1.0, rtol=1e-12)
    assert (one["contact_grain"][:, 0] < one["contact_grain"][:, 1]).all()


def test_a_run_file_with_another_run_is_left_alone_and_only_the_differences_are_named(
    labkit_command, specimen_file, run_file
):
    before = run_file.read_bytes()
    done = labkit_command("run", "cv", specimen_file, "--strain", 0.03, "--engine", "yade", "-o", run_file)
    difference = "strain is 0.02 in the file, 0.03 here; snapshots is 5 in the file, 20 here"
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1
    assert (
        f"holds another run ({difference}): choose another file, or give the same options to resume it" in done.stderr
    )
    assert run_file.read_bytes() == before


def test_a_selection_of_snapshots_computes_from_its_own_contacts(run):
    whole = run.lab.love_stress().values
    np.testing.assert_array_equal(run.isel(snapshot=slice(2, 4)).lab.love_stress(), whole[2:4])
    np.testing.assert_array_equal(run.isel(time=slice(0, 3)).lab.love_stress(), whole)
    assert run.lab.contacts(-1).sizes["contact"] == int(run["row_size"][-1])
    assert run.isel(snapshot=slice(0, 0)).lab.sff_stress().shape == (0, 3, 3)


def test_verify_prints_the_table_and_draws_the_figure(labkit_command, run_file, tmp_path):
    figure = tmp_path / "figure.png"
    done = labkit_command("verify", run_file, "-o", figure, "--csv", tmp_path / "findings.csv")
    assert done.returncode in (0, 1), done.stderr
    for word in ("strain", "Lambda", "A_zz", "F_zz", "Ft_zz", "C0 error", "momentum", "inertial number"):
        assert word in done.stdout
    assert figure.read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "findings.csv").read_text().startswith("run,name,value,limit,holds,decides")


def test_a_run_ends_when_its_cell_is_thinner_than_two_grains(soft_specimen, tmp_path):
    """It would go on with contacts across two faces of the cell, and the energy balance would blame the time step."""
    file = tmp_path / "thin.run.nc"
    path = lk.paths.ConstantVolume(strain="200 %", rate=1000.0)
    with pytest.raises(lk.PhysicsError, match="less than two of the largest grains"):
        lk.run(soft_specimen, path, file=file, progress=False, record_strain=0.02)
    run = lk.Run.open(file)
    width = widths(run.data["cell"].values).min(axis=1) / (2.0 * run.data["radius"].values.max())
    assert not run.complete and width[-1] < 2.0 <= width[-2] and run.ended_because
    (found,) = (one for one in lk.verify(run) if one.name.startswith("least width of the cell"))
    assert found.value == width[-1] and not found.holds


def test_a_limit_is_named_by_the_strain_that_the_path_drives(loose_specimen, tmp_path):
    path, file = lk.paths.SimpleShear(pressure=3e5, strain=0.02, rate=60.0), tmp_path / "r.run.nc"
    run = lk.run(loose_specimen, path, file=file, progress=False, snapshots=0, record_strain=2e-3)
    (limit,) = (one for one in run.exceeded if one.name == "inertial number")
    assert limit.strain[1] == pytest.approx(0.02, rel=0.02) and "at shear strains gamma_xz from " in str(limit)
    assert [str(one) for one in exceeded_in(file)] == [str(one) for one in run.exceeded]


def test_the_void_ratio_at_which_a_test_starts_is_said_beside_that_of_its_specimen(
    loose_specimen, tmp_path, labkit_command
):
    file = tmp_path / "s.state.nc"
    lk.write_state(file, loose_specimen)
    done = labkit_command("run", "cp", file, "--pressure", "100kPa", "--strain", 0.002, cwd=tmp_path)
    (out,) = tmp_path.glob("*.run.nc")
    start = float(lk.open_run(out)["void_ratio_nominal"][0])
    said = f"the test starts at a nominal void ratio of {start:.4f}; the specimen was made at 0.6700"
    assert start > 0.672 and said in done.stdout
    assert said in labkit_command("info", out).stdout
    assert "the specimen was made" not in labkit_command("info", tmp_path / "s.state.nc").stdout
