"""Which runs and measured tests can be compared, and what is said about those that can."""

import warnings

import numpy as np
import pytest

import labkit as lk
from labkit.plugins.laboratory_data import remarks
from tests.plugins.laboratory_data.columns import of_columns

GIVEN = {"strain_kind": "logarithmic", "stress_kind": "effective", "source": "own numbers", "licence": "CC0"}
COLUMNS = of_columns(e1="e:1", ev="v:1", q="q:kPa", s3="s:kPa")
PATHS = {
    "cr": lambda p, strain: lk.paths.ConstantRadialStress(pressure=p, strain=strain),
    "cp": lambda p, strain: lk.paths.ConstantMeanStress(pressure=p, strain=strain),
    "cv": lambda p, strain: lk.paths.ConstantVolume(strain=strain),
    "oedometer": lambda p, strain: lk.paths.Oedometer(strain=strain),
}


def test_of(folder, path="cr", pressure=100.0, strain=0.14, void_ratio=0.8, factor=1.0, engine="laboratory"):
    """Return a test, whose q is `factor` times that of the others."""
    file, at = folder / "t.txt", np.linspace(0.0, 0.2, 101)
    q = 2.0 * factor * pressure * at
    radial = pressure - q / 3.0 if path == "cp" else np.full_like(q, pressure)
    volume = 0.0 * at if path == "cv" else 0.1 * at
    rows = np.array([at, volume, q, radial]).T
    file.write_text("e v q s\n" + "\n".join(" ".join(map(repr, row.tolist())) for row in rows))
    measured = lk.read_measured(file, PATHS[path](1e3 * pressure, strain), COLUMNS, void_ratio=void_ratio, **GIVEN)
    measured.data.attrs["engine"] = engine
    return measured


test_of.__test__ = False


def run_of(folder, **given):
    return test_of(folder, engine="fused", **given)


def test_the_misfit_of_tests_that_differ_by_a_factor_is_known(tmp_path):
    """q of the run is 1.5 q: the differences are 0.5 q = 100 kPa x strain, at 71 strains from 0 to 0.14."""
    run, measured = run_of(tmp_path, factor=1.5), test_of(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = lk.misfit(run, measured, {"q": 5e3})
    at = np.linspace(0.0, 0.14, 71)
    assert found["q"] == pytest.approx(float(np.sqrt(np.mean((1e5 * at / 5e3) ** 2))), rel=1e-9)
    assert remarks(run, measured) == []


@pytest.mark.parametrize(
    ("run", "message"),
    [
        ({"path": "cp"}, "the run follows the path cp, and the measured test cr: give runs of one path"),
        ({"path": "cv"}, "the run cv is undrained, and the measured test cr is drained: give a run of the path cr"),
        ({"path": "oedometer"}, "path oedometer"),
        ({"pressure": 300.0}, "starts from 300 kPa, and the measured test from 100 kPa: give a run at the pressure"),
        ({"pressure": 70.0}, "starts from 70 kPa"),
    ],
)
def test_what_cannot_be_compared_is_refused(tmp_path, run, message):
    with pytest.raises(lk.InputError, match=message):
        lk.misfit(run_of(tmp_path, **run), test_of(tmp_path), {"q": 1e3})


def test_swapped_arguments_are_refused(tmp_path):
    with pytest.raises(lk.InputError, match="wrong order: give the run first, then the test"):
        lk.misfit(test_of(tmp_path), run_of(tmp_path), {"q": 1e3})


@pytest.mark.parametrize(
    ("run", "remark"),
    [
        ({"strain": 0.08}, r"compared up to the strain 8 % of the run; the measured test goes to 14 %"),
        ({"pressure": 110.0}, r"the run starts from 110 kPa, and the measured test from 100 kPa"),
        ({"void_ratio": 0.7}, r"void ratio of 0.700, and the measured test from 0.800: compare relative densities"),
    ],
)
def test_what_differs_a_little_is_said(tmp_path, run, remark):
    run, measured = run_of(tmp_path, **run), test_of(tmp_path)
    with pytest.warns(UserWarning, match=remark):
        lk.misfit(run, measured, {"q": 1e3})


def test_a_longer_run_and_two_measured_tests_need_no_remark(tmp_path):
    assert remarks(run_of(tmp_path, strain=0.2), test_of(tmp_path)) == []
    assert remarks(test_of(tmp_path, factor=1.1), test_of(tmp_path)) == []
    assert "run of the engine fused" in remarks(run_of(tmp_path), run_of(tmp_path))[0]


def test_a_path_in_steps_may_repeat_any_test(tmp_path):
    run = run_of(tmp_path)
    run.data.attrs["path"] = "mixed"
    run.data.attrs["path_parameters"] = "{}"
    assert "follows the path mixed" in remarks(run, test_of(tmp_path))[0]
