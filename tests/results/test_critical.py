"""Critical states: which runs are used and which are left out, by name and reason."""

import re
import shutil

import numpy as np
import pandas
import pytest

import labkit
from labkit.errors import InputError
from labkit.plugins.campaigns.products import numbers
from labkit.results import ENOUGH_STRAIN, require_critical
from labkit.results.critical import critical_states
from tests.changed import changed
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

RUNS = ROOT / "results/paper/runs"
LONG = ("cv-dense", "cr_500kPa-loose")
START = ("--void-ratio", 0.67, "--pressure", 0.5e6)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Name -> run file: two complete tests of the paper, one interrupted, one without shear, one unfinished."""
    folder = tmp_path_factory.mktemp("critical")
    known = {name: folder / f"{name}.run.nc" for name in (*LONG, "isod-dense_high", "unfinished", "short")}
    for name, file in known.items():
        shutil.copy(RUNS / f"{name if name not in ('unfinished', 'short') else 'cv-dense'}.run.nc", file)
    with changed(known["unfinished"]) as dataset:
        dataset.complete = 0
    with changed(known["short"]) as dataset:  # a complete test to 4 % strain
        for name in ("axial_strain", "strain"):
            dataset[name][:] = dataset[name][:] * 0.1
    return known


@pytest.fixture(scope="module")
def model_file(files, labkit_command):
    """A prediction of the model to 60 % strain."""
    file = files["short"].with_name("model.run.nc")
    done = labkit_command("model", "cv", *START, "--strain", 0.6, "-o", file)
    assert done.returncode == 0, done.stderr
    return file


def test_runs_that_do_not_reach_a_critical_state_are_left_out_with_a_reason(files):
    runs = {name: labkit.open_run(file) for name, file in files.items()}
    kept, left_out = require_critical(runs)
    assert tuple(kept) == LONG
    assert left_out == {
        "isod-dense_high": "path isod is not a shear test",
        "unfinished": "unfinished, stopped at 40.00% axial strain",
        "short": "ends at 4.00% axial strain, before 0.15",
    }
    assert "short" in require_critical(runs, 0.04)[0]  # the least strain is included, in single precision too


def test_the_numbers_of_a_run_have_a_critical_state_only_if_it_is_one(files):
    known = {name: numbers(labkit.open_run(file)) for name, file in files.items()}
    assert known["cv-dense"]["critical_M"][0] == pytest.approx(0.92, abs=0.1)
    shown = critical_states({"run": labkit.open_run(files["cv-dense"])})["critical"][0] == "yes"
    assert known["cv-dense"]["critical_shown"][0] == shown and np.isnan(known["short"]["critical_shown"][0])
    for name in ("short", "unfinished"):
        assert np.isnan(known[name]["critical_M"][0]) and np.isnan(known[name]["critical_Z"][0])
    assert "critical_M" not in known["isod-dense_high"]


def test_predictions_of_the_model_are_not_averaged_with_simulations(files, model_file):
    runs = {name: labkit.open_run(files[name]) for name in LONG} | {"model": labkit.open_run(model_file)}
    kept, left_out = require_critical(runs)
    assert tuple(kept) == LONG and list(left_out) == ["model"]
    assert tuple(require_critical({"model": runs["model"]})[0]) == ("model",)  # on their own they are a valid set


def test_nothing_left_is_an_error_that_names_each_run(files):
    runs = {name: labkit.open_run(files[name]) for name in ("unfinished", "short")}
    with pytest.raises(InputError, match=r"reaches a critical state.*unfinished: unfinished.*short: ends at 4.00%"):
        require_critical(runs)
    with pytest.raises(InputError, match="none of these runs is a shear test"):
        require_critical({"isod": labkit.open_run(files["isod-dense_high"])})


def test_the_command_averages_only_the_runs_that_reach_a_critical_state(files, model_file, labkit_command, tmp_path):
    done = labkit_command("critical", *files.values(), model_file, "-o", tmp_path / "all.png")
    alone = labkit_command(
        "critical", *(files[name] for name in LONG), "-o", tmp_path / "alone.png", "--csv", tmp_path / "e.csv"
    )
    assert done.returncode == alone.returncode == 0, done.stderr
    average, with_more = (re.findall("^mean M of all.*", one.stdout, re.MULTILINE) for one in (alone, done))
    assert average and average == with_more
    table = pandas.read_csv(tmp_path / "e.csv")
    np.testing.assert_allclose(table["e_c"], table["e"], rtol=1e-5)  # a line through two tests, without an interval
    assert table["e_c_within"].isna().all() and "2 tests of 2 specimens" in alone.stdout
    assert done.stdout.count("left out: ") == 4 and "left out: short: ends at 4.00% axial strain" in done.stdout
    refused = labkit_command("critical", files["short"], "-o", tmp_path / "none.png")
    assert refused.returncode == 2 and len(refused.stderr.strip().splitlines()) == 1
    assert f"before {ENOUGH_STRAIN}" in refused.stderr and not (tmp_path / "none.png").exists()
    lower = labkit_command("critical", files["short"], "--min-strain", 0.03, "-o", tmp_path / "lower.png")
    assert lower.returncode == 0, lower.stderr


@pytest.mark.parametrize(
    "columns, reason",
    [
        ({}, "two tests or more, and the table has 0"),
        ({"p_MPa": [1.0], "e": [0.7]}, "two tests or more, and the table has 1"),
        ({"p_MPa": [1.0, 2.0]}, "has no column e"),
        ({"p_MPa": [1.0, np.nan], "e": [0.7, 0.6]}, "a positive p"),
        ({"p_MPa": [1.0, -2.0], "e": [0.7, 0.6]}, "a positive p"),
        ({"p_MPa": [1.0, 1.1], "e": [0.7, 0.6]}, "differs by a factor"),
    ],
)
def test_a_table_without_a_line_is_refused_for_its_own_reason(columns, reason):
    with pytest.raises(InputError, match=reason):
        labkit.critical_line(pandas.DataFrame(columns))
