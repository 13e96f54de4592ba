"""The sheet of a predicted test: intervals, PDF, AGS4."""

import sys

import numpy as np
import pytest
from scipy.stats import t as student

import labkit as lk
from labkit.cli import main
from labkit.errors import InputError
from labkit.plugins.laboratory_data.ags4 import write_ags4
from labkit.plugins.laboratory_data.sampling import append_sample
from labkit.plugins.laboratory_data.sheet import Prediction, write_pdf
from tests.plugins.laboratory_data.test_calibrating import FREE, SCATTER, curves, imagined_samples, measured_test

PATH = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.1)
FRICTIONS = (0.4, 0.5, 0.7)


@pytest.fixture
def prediction(tmp_path):
    """The imagined material with three frictions, whose curves are known."""
    runs = [measured_test(tmp_path, friction=friction) for friction in FRICTIONS]
    return Prediction(PATH, 0.75, runs, SCATTER, 2.0, ("loose", "dense"))


def test_the_interval_has_the_scatter_of_the_draws_and_the_misfit(prediction):
    row = prediction.curves("stress_ratio", np.array([0.05])).iloc[0]
    values = [curves(friction, 0.13, 0.5)[0] for friction in FRICTIONS]
    half = student.ppf(0.95, 2) * np.sqrt(np.var(values, ddof=1) * 4 / 3 + (2.0 * 0.03) ** 2)
    assert row["predicted"] == pytest.approx(np.mean(values), rel=1e-3)
    assert (row["high"] - row["low"]) / 2 == pytest.approx(half, rel=2e-3)
    assert [*prediction.table()["quantity"]] == ["stress_ratio"] * 3 + ["volumetric_strain"] * 3


def test_the_pdf_is_one_page_of_a4(prediction, tmp_path):
    write_pdf(prediction, str(tmp_path / "sheet.pdf"))
    content = (tmp_path / "sheet.pdf").read_bytes()
    assert content.startswith(b"%PDF") and content.count(b"/Type /Page ") == 1 and b"595.44 841.68" in content


def test_ags4_passes_the_checker_and_is_read_back(prediction, tmp_path):
    ags4, file = pytest.importorskip("python_ags4.AGS4"), str(tmp_path / "sheet.ags")
    write_ags4(prediction, file)
    assert ags4.count_errors(ags4.check_file(file)) == (0, 0, 0)
    tables, _ = ags4.AGS4_to_dataframe(file)
    numbers = {name: ags4.convert_to_numeric(table) for name, table in tables.items()}
    assert tables["TREG"]["TREG_TYPE"].iloc[-1] == "CIDC" and numbers["TRET"]["TRET_CONP"].iloc[-1] == 100
    ratio = numbers["TREP"].query("TREP_QNTY == 'stress_ratio'")
    expected = prediction.curves("stress_ratio", ratio["TREP_STRN"].to_numpy() / 100.0)
    for column, name in (("TREP_MEAN", "predicted"), ("TREP_LOW", "low"), ("TREP_HIGH", "high")):
        np.testing.assert_allclose(ratio[column], expected[name], atol=2e-3)


def test_without_the_library_and_for_other_paths_there_is_one_sentence(prediction, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "python_ags4.AGS4", None)
    with pytest.raises(InputError, match=r"AGS4 files need python_ags4: .*pip install .*ags4"):
        write_ags4(prediction, str(tmp_path / "sheet.ags"))
    assert not (tmp_path / "sheet.ags").exists()


@pytest.mark.slow
def test_the_command_predicts_with_grains(tmp_path, capsys, monkeypatch):
    """Grains of a calibration on imagined samples; the test is short, and the specimens small."""
    pytest.importorskip("sklearn")
    pytest.importorskip("emcee")
    monkeypatch.chdir(tmp_path)
    lk.write_measured(measured_test(tmp_path), "one.run.nc")
    for sample in imagined_samples(12):
        append_sample(sample, "samples.jsonl")
    free = [f"{name}={low}..{high}" for name, (low, high) in FREE.items()]
    scatter = [f"{name}={value}" for name, value in SCATTER.items()]
    words = ["predict", "cr", "one.run.nc", "--pressure=100kPa", "--strain=0.01", "--rate=50", "--void-ratio=0.75"]
    words += ["--free", *free, "--scatter", *scatter, "--samples", "samples.jsonl", "--draws=2", "--grains=150"]
    words += ["--void-ratio-limits", "0.6", "0.9", "-o", "sheet.pdf"]
    assert main([*words, "--csv", "sheet.csv"]) == 0
    out = capsys.readouterr().out
    assert "Path cr at 100 kPa, void ratio 0.75, from one" in out and "stress_ratio" in out
    assert len((tmp_path / "sheet.csv").read_text().splitlines()) >= 7
    assert main([*words, "--draws=1"]) == 2
    assert main([*words[:2], "no.run.nc", *words[3:]]) == 2
