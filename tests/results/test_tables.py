"""Records and contacts as tables: component labels, stress ratio, `labkit export`, and the text of `labkit info`."""

import numpy as np
import pandas
import pytest

import labkit
from labkit.files.schema import RECORD
from labkit.results.info import describe_file


@pytest.fixture(scope="module")
def run(run_file):
    return labkit.open_run(run_file)


def test_components_are_selected_by_axis_labels(run, run_file, specimen_file):
    np.testing.assert_array_equal(run["stress"].sel(i="z", j="x"), run["stress"][:, 2, 0])
    data = labkit.Run.open(run_file).data
    np.testing.assert_array_equal(data["strain"].sel(i="z", j="z"), data["axial_strain"])
    np.testing.assert_array_equal(data["normal"].sel(i="y"), data["normal"][:, 1])
    assert list(labkit.open_state(specimen_file)["i"].values) == ["x", "y", "z"]
    love = run.lab.love_stress().sel(i="z", j="z")
    np.testing.assert_allclose(love, run.lab.at_snapshots("stress").sel(i="z", j="z"), rtol=1e-9)
    assert "i" not in run.lab.over_snapshots(lambda snapshot: {"sides": 2 * len(snapshot.contacts)}).coords


def test_the_stress_ratio_is_dimensionless_and_named(run):
    ratio = run.lab.stress_ratio()
    assert ratio.attrs == {"units": "1", "long_name": "stress ratio q/p"} and ratio.dims == ("time",)
    np.testing.assert_array_equal(ratio, run.lab.deviatoric_stress().values / run.lab.mean_stress().values)
    assert float(run.lab.stress_ratio("stress_sff")[-1]) == pytest.approx(float(ratio[-1]), rel=0.1)
    assert np.isnan(run.assign(stress=0.0 * run["stress"]).lab.stress_ratio()).all()  # without a warning
    np.testing.assert_allclose(ratio.plot(x="axial_strain")[0].get_ydata(), ratio)


def test_mobilisation_is_explained_in_its_long_name(run):
    for data in (run, run.lab.statistics()):
        assert "tangential force" in data["mobilisation"].attrs["long_name"]
        assert data["mobilisation"].attrs["long_name"] == RECORD["mobilisation"].long_name


def test_records_are_a_table_with_one_column_per_component(run):
    frame = run.lab.to_dataframe()
    assert len(frame) == run.sizes["time"] and list(frame.columns[:5]) == ["time", "axial_strain", "p", "q", "q_over_p"]
    np.testing.assert_array_equal(frame["stress_xz"], run["stress"][:, 0, 2])
    np.testing.assert_array_equal(frame["stress_zx"], run["stress"][:, 2, 0])
    np.testing.assert_array_equal(frame["drift_velocity_y"], run["drift_velocity"][:, 1])
    np.testing.assert_array_equal(frame["q_over_p"], run.lab.stress_ratio())
    np.testing.assert_allclose(frame[["stress_xx", "stress_yy", "stress_zz"]].mean(axis=1), frame["p"], rtol=1e-12)
    for name, variable in RECORD.items():
        components = 3 ** (len(variable.dimensions) - 1)
        columns = [c for c in frame.columns if c == name or (components > 1 and c.removesuffix(c[-3:]) == name)]
        assert components == 1 or name == "drift_velocity" or len([c for c in columns if c != name]) == components, name
    assert not frame.drop(columns="inertial_number").isna().any().any()
    named = run.lab.to_dataframe(units=True)
    assert {"time [s]", "p [Pa]", "q_over_p", "axial_strain", "cell_zz [m]"} <= set(named.columns)
    np.testing.assert_array_equal(named.to_numpy(), frame.to_numpy())


def test_a_selection_of_records_is_a_table_too(run):
    part = run.isel(time=slice(3, 7))
    pandas.testing.assert_frame_equal(
        part.lab.to_dataframe(), run.lab.to_dataframe().iloc[3:7].reset_index(drop=True), check_exact=True
    )


def test_contacts_of_a_snapshot_are_a_table(run):
    frame, snapshot = run.lab.contacts_table(-1), run.lab.snapshot(-1)
    assert len(frame) == len(snapshot.contacts) and frame["contact_grain_2"].max() < run.sizes["grain"]
    np.testing.assert_array_equal(frame["normal_force"], snapshot.contacts.normal_force)
    np.testing.assert_array_equal(frame[["normal_x", "normal_y", "normal_z"]], snapshot.contacts.normal)


def test_export_writes_the_records_and_the_contacts_of_a_snapshot(run, run_file, labkit_command, tmp_path):
    done = labkit_command("export", run_file, "-o", tmp_path / "r.csv")
    assert done.returncode == 0 and f"{run.sizes['time']} records" in done.stdout, done.stderr
    pandas.testing.assert_frame_equal(pandas.read_csv(tmp_path / "r.csv"), run.lab.to_dataframe(units=True))
    assert (tmp_path / "r.csv.provenance.json").exists()
    done = labkit_command("export", run_file, "--snapshot", -1, "-o", tmp_path / "c.csv")
    last = run.lab.number_of_snapshots - 1
    assert done.returncode == 0 and f"contacts of snapshot {last}" in done.stdout, done.stderr
    columns = (tmp_path / "c.csv").read_text().splitlines()[0].split(",")
    written = np.loadtxt(tmp_path / "c.csv", delimiter=",", skiprows=1)  # pandas 2 reads to 15 digits
    expected = run.lab.contacts_table(last, units=True)
    assert columns == list(expected.columns) and "normal_force [N]" in columns
    np.testing.assert_array_equal(written, expected.to_numpy())


def test_export_refuses_what_it_cannot_write(run_file, labkit_command, tmp_path):
    before = run_file.read_bytes()
    for arguments, hint in (
        ([run_file, "-o", run_file], "would be overwritten"),
        ([run_file, "--snapshot", 99, "-o", tmp_path / "c.csv"], "snapshot 99 is not in"),
        ([tmp_path / "none.run.nc"], "does not exist"),
    ):
        done = labkit_command("export", *arguments)
        assert done.returncode == 2 and hint in done.stderr and len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == [] and run_file.read_bytes() == before


def test_info_prints_values_in_lines_and_integers_in_full(run_file, specimen_file):
    for file in (run_file, specimen_file):
        text = describe_file(file)
        assert "{" not in text and "young_modulus" in text and " Pa\n" in text
    grains = labkit.read_state(specimen_file).number_of_grains
    assert f"grains {grains}" in " ".join(describe_file(specimen_file).split())
    assert "1.5e+08 Pa" in text and "time_step" in text
