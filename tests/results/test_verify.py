"""The checks of `labkit verify` fail on spoiled files."""

import shutil

import numpy as np
import pytest

import labkit
import labkit as lk
from labkit.errors import LabkitWarning
from labkit.files.schema import BY_VOLUME
from labkit.records.limits import exceeded_in
from labkit.results.verify import findings, verify
from tests.changed import changed
from tests.files.test_older_files import without


@pytest.fixture
def spoiled(run_file, tmp_path):
    """A function that spoils a copy of the run with `spoil(dataset)` and returns its findings by name."""

    def make(spoil):
        file = tmp_path / "spoiled.run.nc"
        shutil.copy(run_file, file)
        with changed(file) as dataset:
            spoil(dataset)
        found = findings(labkit.open_run(file))
        return {finding.name.split(",")[0]: finding for finding in found} | {finding.name: finding for finding in found}

    return make


def test_contacts_that_were_changed_fail(spoiled):
    def spoil(dataset):
        dataset["contacts"]["normal_force"][7] = 2 * dataset["contacts"]["normal_force"][7]

    assert not spoiled(spoil)["stored stress against its contacts"].holds


def test_an_infinite_inertial_number_is_outside(spoiled):
    def spoil(dataset):
        dataset["inertial_number"][3] = np.inf

    assert not spoiled(spoil)["largest inertial number"].holds


def test_a_volume_that_drifts_fails(spoiled):
    def spoil(dataset):
        dataset["volume"][-1] = dataset["volume"][-1] * (1 + 1e-9)

    assert not spoiled(spoil)["held: volume"].holds


def test_another_soil_is_judged_by_the_same_limit(spoiled):
    def wide(dataset):
        dataset["stress_sff_by_volume"][:] = 1.1 * dataset["stress"][:]
        dataset.scene = lk.Scene(diameter_spread=0.4).to_json()

    found = spoiled(wide)
    for name in ("largest error, norm (p > 50 kPa)", "largest error of p, which is exact"):
        equation = found[f"equation by volume: {name}"]
        assert not equation.holds and equation.decides
    assert not any("as in the paper" in name for name in found)


def test_a_held_stress_off_its_target_is_exceeded_and_fails_alike(soft_specimen, tmp_path):
    file = tmp_path / "cr.run.nc"
    run = lk.run(soft_specimen, lk.paths.ConstantRadialStress(pressure=1e5, strain=0.02), file=file, progress=False)
    assert not [one for one in run.exceeded if "held" in one.name]
    file = shutil.copy(file, tmp_path / "spoiled.run.nc")
    with changed(file) as dataset:
        stress = dataset["stress"][:]
        stress[-3:, 0, 0] *= 1.3
        dataset["stress"][:] = stress
    (held,) = (one for one in lk.Run.open(file).exceeded if "held" in one.name)
    assert (held.name, held.limit, held.records) == ("relative error of the held radial stress", 0.02, 3)
    assert held.largest == pytest.approx(0.15 if "mean" in held.name else 0.3, abs=0.02)
    assert [str(one) for one in exceeded_in(file)] == [str(one) for one in lk.Run.open(file).exceeded]
    largest = next(one for one in verify(file) if one.name == "held: radial stress, largest error")
    assert largest.decides and not largest.holds and largest.value == held.largest


def test_a_printed_c0_that_is_off_is_shown_and_recomputed(spoiled):
    def spoil(dataset):
        dataset["stress_sff"][:] = dataset["stress_sff"][:] * 1.1

    found = spoiled(spoil)
    printed = found["C0 as printed: largest error, norm"]
    assert printed.value == pytest.approx(0.1, abs=0.03) and not printed.decides and not printed.limit
    assert not found["stored stress against its contacts"].holds


def test_older_files_are_judged_at_their_snapshots_or_not_at_all(run_file, tmp_path):
    whole = {finding.name: finding for finding in verify(run_file)}
    at_records = whole["equation by volume: largest error, norm (p > 50 kPa)"]
    older = without(run_file, tmp_path / "older.run.nc", set(BY_VOLUME))
    at_snapshots = {finding.name: finding for finding in verify(older)}
    name = "equation by volume: largest error, norm (snapshots, p > 50 kPa)"
    assert 0.0 < at_snapshots[name].value <= at_records.value
    assert at_snapshots["equation by volume: largest error of p, which is exact"].value < 1e-6
    assert at_snapshots["C0 as printed: largest error, norm"] == whole["C0 as printed: largest error, norm"]
    with labkit.open_run(older) as run:
        blind = {finding.name: finding for finding in findings(run.isel(snapshot=slice(0), contact=slice(0)))}
    assert "equation by volume: not judged, an older file without snapshots" in blind
    assert not [name for name in blind if name.startswith("equation by volume: largest")]


def test_a_sieve_curve_of_ratio_4_passes_and_the_printed_equation_does_not(tmp_path):
    """Grains from 0.1 to 0.4 mm: C0 as printed errs by more than 10 %, the equation by volume by less than 2 %."""
    scene = lk.Scene(law="spring_dashpot", grading="sieve diameters=0.1mm,0.15mm,0.25mm,0.4mm passing=0,35%,75%,100%")
    recipe = lk.Recipe(preparation="compression", pressure=500e3, grains=400)
    state = lk.make_specimen(recipe, scene, progress=False)
    path = lk.paths.ConstantMeanStress(pressure=500e3, strain=0.02)
    with pytest.warns(LabkitWarning, match="the inertial number 0.001 is above the limit 0.0003"):
        run = lk.run(state, path, progress=False, snapshots=2, inertial_number=1e-3)
    found = {finding.name: finding for finding in lk.verify(run)}
    equation = found["equation by volume: largest error, norm (p > 50 kPa)"]
    assert equation.holds and equation.value < 0.02
    assert found["C0 as printed: largest error, norm"].value > 0.1
    assert "ok" in str(equation) and "C0 as printed" in str(lk.verify(run))


def test_errors_in_p_and_q_are_told_apart(spoiled):
    """A deviator 3 % too small is hidden in the norm and the mean stress; p stays exact."""

    def spoil(dataset):
        love = dataset["stress"][:].filled()
        p = np.trace(love, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        dataset["stress_sff"][:] = p + 0.97 * (love - p)
        dataset["stress_sff_by_volume"][:] = dataset["stress_sff"][:]

    found = {name: finding.value for name, finding in spoiled(spoil).items()}
    assert found["equation by volume in q, mean relative error"] == pytest.approx(-0.03, abs=1e-9)
    assert found["C0 in q, mean relative error"] == pytest.approx(-0.03, abs=1e-9)
    assert found["C0 in q, RMS relative error"] == pytest.approx(0.03, abs=1e-9)
    assert found["C0 in q/p, mean relative error"] == pytest.approx(-0.03, abs=1e-9)
    assert found["C0 in p, mean relative error"] == pytest.approx(0.0, abs=1e-9)
