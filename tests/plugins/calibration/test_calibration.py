"""Calibration: parameters are recovered from noisy synthetic runs; those not determined are reported."""

import dataclasses
import json

import numpy as np
import pandas
import pytest
import xarray as xr

import labkit
from labkit.errors import InputError
from labkit.files.schema import RECORD
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.run_file import as_run, records_of_result
from labkit.model.state import isotropic_state, state_of
from labkit.plugins.calibration.fitting import DETERMINED, calibrate, critical_fit, fit
from labkit.plugins.calibration.observation import observe, require_usable
from labkit.plugins.calibration.residuals import predict

pytestmark = pytest.mark.slow

NOISE = {
    "coordination_number": 0.03,
    "mean_normalised_force": 1e-4,
    "contact_anisotropy": 0.02,
    "normal_force_anisotropy": 0.02,
    "mobilisation": 0.002,
}
TESTS = (
    ("cv", 0.606, 0.2e6),
    ("cv", 0.67, 0.7e6),
    ("cv", 0.72, 0.8e6),
    ("cp", 0.62, 0.5e6),
    ("cr", 0.70, 0.5e6),
    ("isoc", 0.67, 0.5e6),
    ("isoc", 0.72, 0.3e6),
    ("isod", 0.65, 1e6),
)


def attributes(path):
    return {"path": path, "scene": labkit.Scene().to_json()}


def synthetic(model, rng, tests=TESTS):
    """Observations of model predictions with white noise on the statistics that a simulation measures."""
    found = []
    for number, (name, e, pressure) in enumerate(tests):
        result = drive(model, model_path(name, pressure), isotropic_state(model, e, pressure)).require()
        values = records_of_result(result)
        run = xr.Dataset({key: (RECORD[key].dimensions, values[key]) for key in RECORD}, attrs=attributes(name))
        for key, size in NOISE.items():
            noise = rng.normal(size=run[key].shape)
            # the triaxial zz component of a tensor is 2/3 (zz - (xx + yy)/2): scaled so that its noise is `size`
            run[key] = run[key] + size * noise * (1.0 if run[key].ndim == 1 else np.sqrt(1.5))
        found.append(observe(f"{name}{number}", run))
    return found


def test_parameters_are_recovered_within_their_error_bars(model):
    """Nine in ten of the 132 95 % intervals, of all parameters in six sets of noisy runs, contain the true value."""
    truth = model.with_parameters(c_eZ=6.0, c_M=80.0, beta_dA=28.0, c_vZ=0.12, F_c=0.9, e_cmax=0.77, c_vLamd=0.09)
    expected = pandas.Series(dataclasses.asdict(truth.parameters))
    inside, errors = [], []
    for seed in range(6):
        table = fit(synthetic(truth, np.random.default_rng(seed))).table.set_index("parameter")
        inside.append((table["low"] <= expected) & (expected <= table["high"]))
        errors.append((table["standard_error"] / expected)[table["determined"]])
        assert table["determined"].sum() >= 20
    inside = pandas.concat(inside, axis=1)
    assert inside.to_numpy().mean() >= 0.9
    assert inside.mean(axis=1).min() >= 0.5  # and no parameter has a systematic error
    assert np.median(pandas.concat(errors)) < 0.05  # and the intervals are narrow


def test_a_fit_without_noise_finds_the_truth(model):
    truth = model.with_parameters(c_eZ=6.0, c_M=80.0, F_c=0.9)
    observations = synthetic(truth, np.random.default_rng(0))
    for o in observations:
        o.values[:] = fit_free_prediction(truth, o)
    found = dataclasses.asdict(fit(observations).model.parameters)
    for name, value in dataclasses.asdict(truth.parameters).items():
        assert np.isclose(found[name], value, rtol=2e-3), name


def fit_free_prediction(model, observation):
    first = observation.values[0] * np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    return predict(observation, first, model.reading(beyond_e_cmax="flat").constants)


def test_parameters_that_the_runs_do_not_determine_are_reported(model):
    """Constant-volume tests do not depend on Eqs. 31 and 32; isotropic compression does not depend on shear."""
    rng = np.random.default_rng(1)
    sheared = fit(synthetic(model, rng, TESTS[:3]))
    warnings = " ".join(sheared.warnings)
    for name in ("c_com", "c_vZ", "beta_vZ", "c_vLamd"):
        assert name in warnings and not sheared.table.set_index("parameter")["determined"][name]
        assert getattr(sheared.model.parameters, name) == getattr(model.parameters, name)
    compressed = fit(synthetic(model, rng, TESTS[5:7]))
    warnings = " ".join(compressed.warnings)
    assert all(name in warnings for name in ("A_c", "F_c", "c_M", "c_eZ", "c_vZ"))
    assert abs(compressed.model.parameters.c_cLam / 0.098 - 1) < 0.05  # Eq. 32 contains it
    assert any("c_com" in pair for pair in compressed.report().split("correlations")[1:])


def test_a_parameter_is_determined_if_its_error_is_small_relative_to_its_fitted_value(model):
    """An exponent far below Table 2 has an error larger than its fitted value, although small relative to Table 2."""
    truth = model.with_parameters(beta_eZ=1.0)
    table = fit(synthetic(truth, np.random.default_rng(4))).table.set_index("parameter")
    row = table.loc["beta_eZ"]
    assert row["fitted"] < 2.0 * row["standard_error"] < 0.5 * row["table_2"] and not row["determined"]
    expected = table["standard_error"] < DETERMINED * table["fitted"]
    pandas.testing.assert_series_equal(table["determined"], expected, check_names=False)


def test_predictions_and_unfinished_runs_are_left_out_with_a_reason(model, run_file):
    """A calibration must not fit the model to its own predictions."""
    simulation = labkit.open_run(run_file)
    predicted = as_run(drive(model, model_path("cv", 0.5e6), isotropic_state(model, 0.67, 0.5e6)))
    unfinished = simulation.assign_attrs(complete=0)
    measured = simulation.assign_attrs(engine="laboratory")
    runs = {"simulation": simulation, "predicted": predicted, "unfinished": unfinished, "measured": measured}
    usable, left_out = require_usable(runs)
    assert list(usable) == ["simulation"]
    assert left_out == {
        "predicted": "prediction of the model, not a simulation",
        "unfinished": "unfinished",
        "measured": "measured in a laboratory, without contacts",
    }
    result = calibrate(runs)
    assert list(result.predicted) == ["simulation"]
    assert f"warning: left out: predicted: {left_out['predicted']}\n" in result.report()
    assert "no test of drained shear, isotropic compression, isotropic dilation: do not trust" in result.report()
    (row,) = result.misfit.to_dict("records")
    stress = simulation["stress_sff"].values
    ratio = deviatoric_stress(stress) / mean_stress(stress)
    assert 1e-4 < row["p"] < 0.2 and 1e-4 < row["q/p"] / ratio.max() < 0.2
    with pytest.raises(InputError, match=r"none of these runs can be used .*predicted: .*unfinished"):
        calibrate({name: runs[name] for name in ("predicted", "unfinished")})


@pytest.fixture(scope="module", params=[{}, {"law": "hertz_mindlin"}], ids=str)
def stiff(request):
    """A short test of a hundred grains with a Young's modulus of 5 GPa."""
    scene = labkit.Scene(**request.param, young_modulus="5 GPa")
    state = labkit.make_specimen(labkit.Recipe(void_ratio=0.62, grains=100), scene, progress=False)
    return labkit.run(state, labkit.paths.ConstantVolume(strain=0.01), snapshots=2, progress=False)


def test_the_model_has_the_young_modulus_of_the_grains(stiff, run_file):
    """In the state of the grains, the mean stress of the fitted model is their C0."""
    model = calibrate({"stiff": stiff}).model
    first = stiff.snapshots[0]
    assert mean_stress(state_of(first).stress(model)) == pytest.approx(mean_stress(labkit.sff_stress(first)), rel=1e-6)
    with pytest.raises(InputError, match=r"5e\+09 Pa in stiff, 1.5e\+08 Pa in soft"):
        calibrate({"stiff": stiff, "soft": labkit.open_run(run_file)})


def test_an_exponent_that_may_not_be_zero_stays_positive(model):
    """In these tests the slope of Z^c(e) has the wrong sign, so that gamma_cZ tends to zero."""
    observations = synthetic(model.with_parameters(gamma_cZ=1e-3), np.random.default_rng(1), TESTS[:2])
    for o, trend in zip(observations, (-0.05, 0.05), strict=True):
        o.values[:, 0] += np.linspace(0.0, trend, len(o.e))
    assert 0.0 < fit(observations).model.parameters.gamma_cZ < 0.1


def reflected(observation):
    """The same test in extension: axial strain and the zz components have the other sign."""
    signs = np.array([1.0, 1.0, -1.0, -1.0, -1.0])
    step = -observation.strain_step
    return dataclasses.replace(observation, name="extension", strain_step=step, values=observation.values * signs)


def test_compression_and_extension_do_not_cancel_in_the_critical_state(model):
    rng = np.random.default_rng(3)
    compression = synthetic(model, rng, [("cv", 0.64, 0.5e6)])
    both = critical_fit(observation for observation in (*compression, reflected(*compression)))
    expected = critical_fit(compression)
    for name in ("A_c", "F_c", "Ft_c"):
        assert both[name] == pytest.approx(expected[name], rel=1e-12) and both[name] > 0.0


def test_critical_fit_on_long_tests(model):
    rng = np.random.default_rng(2)
    tests = [("cv", e, 0.5e6) for e in (0.60, 0.64, 0.68, 0.72)]
    found = critical_fit(synthetic(model, rng, tests))
    assert abs(found["e_cmax"] - 0.76) < 0.01
    assert abs(found["c_cLam"] / 0.098 - 1) < 0.05
    assert abs(found["F_c"] / (0.77 * np.sqrt(1.5)) - 1) < 0.05
    for e in (0.60, 0.70):  # the line, since c_cZ and gamma_cZ compensate each other
        line = 4 + found["c_cZ"] * (found["e_cmax"] - e) ** found["gamma_cZ"]
        assert abs(line - 4 - 5.57 * (0.76 - e) ** 0.7) < 0.1
    with pytest.raises(InputError, match="the critical state needs"):
        critical_fit(synthetic(model, rng, TESTS[5:6]))


def test_a_real_run_file_is_calibrated(run_file, labkit_command, tmp_path):
    """300 grains to 2 % strain determine few parameters, and the report says so."""
    done = labkit_command(
        "calibrate", run_file, "-o", tmp_path / "p.json", "--csv", tmp_path / "p.csv", "--figure", tmp_path / "p.png"
    )
    assert done.returncode == 0, done.stderr
    assert "warning: no record of these runs depends on" in done.stdout
    assert "left out" not in done.stdout
    assert calibrate({"small": labkit.open_run(run_file)}).report() in done.stdout  # with all of its warnings
    table = pandas.read_csv(tmp_path / "p.csv").set_index("parameter")
    assert not table["determined"]["c_com"] and table["fitted"]["c_com"] == 7.2
    words = ["--void-ratio", 0.67, "--pressure", 0.5e6, "--parameters", tmp_path / "p.json"]
    again = labkit_command("model", "cv", *words, "-o", tmp_path / "m.run.nc")
    assert again.returncode == 0, again.stderr
    run = labkit.open_run(tmp_path / "m.run.nc")
    used = json.loads(run.attrs["model"])["parameters"]
    assert all(np.isclose(used[name], value, rtol=1e-4) for name, value in table["fitted"].items())
    both = labkit_command("calibrate", run_file, tmp_path / "m.run.nc", "--csv", tmp_path / "both.csv")
    assert both.returncode == 0 and "left out: m: " in both.stdout
    assert (tmp_path / "both.csv").read_text() == (tmp_path / "p.csv").read_text()
    inputs = json.loads((tmp_path / "both.csv.provenance.json").read_text())["inputs"]
    assert [item["file"].endswith("small.run.nc") for item in inputs] == [True]
    assert "inputs none" not in labkit_command("info", tmp_path / "p.png").stdout
    refused = labkit_command("calibrate", tmp_path / "m.run.nc", "-o", tmp_path / "q.json")
    assert refused.returncode == 2 and "(m: " in refused.stderr
    assert not (tmp_path / "q.json").exists()


def test_runs_without_contacts_or_strain_are_refused(model):
    rng = np.random.default_rng(3)
    result = drive(model, model_path("cv", 0.5e6, strain=0.02), isotropic_state(model, 0.67, 0.5e6))
    run = xr.Dataset(
        {key: (RECORD[key].dimensions, value) for key, value in records_of_result(result).items()},
        attrs=attributes("cv"),
    )
    lost = run.copy()
    lost["coordination_number"] = lost["coordination_number"] * (np.arange(len(result)) < 5)
    with pytest.raises(InputError, match="records with contacts"):
        observe("lost", lost)
    still = run.copy()
    still["strain"] = 0.0 * still["strain"]
    with pytest.raises(InputError, match="not strained"):
        observe("still", still)
    with pytest.raises(InputError, match="at least one run"):
        fit([])
    assert len(synthetic(model, rng, TESTS[:1])[0].e) <= 80
