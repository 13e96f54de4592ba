"""`./lab paper` from the first grain to the report: a small campaign with a run that fails, then without it."""

import pandas
import pytest

from analysis.campaigns import simulate
from analysis.paper import runs
from analysis.paper.drawn import OF_RUNS, OTHERS
from analysis.paper.tables import write_tables

CAMPAIGN = """
settings: quick
engine: fused
specimens:
  dense: {void_ratio: 0.62, grains: 200, law: spring_dashpot}
runs:
  cv-dense: {path: cv, specimen: dense, strain: 0.2, rate: 100 1/s}
"""
WILD = "  wild: {path: cv, specimen: dense, strain: 0.2, time_step_factor: 2}\n"
TABLES = (
    "fidelity.csv fidelity.md critical_states.csv critical_lines.csv one_critical_line.csv components.csv "
    "stationarity.csv c0_bias.csv critical_extrapolated.csv sff.csv parameters.csv model_errors.csv model_errors.md "
    "engines.csv campaign.csv"
).split()

OF_CONTACTS = ("force_fits.csv", "force_fits.png", "gallery.png", "printed_force.csv", "size_groups.nc")

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    (folder / "campaign").mkdir()
    return folder


@pytest.fixture(scope="module")
def first(folder, study_command):
    """Finished process of the campaign with a run that fails."""
    (folder / "campaign/campaign.yaml").write_text(CAMPAIGN + WILD)
    return study_command("paper", folder / "campaign", "-o", folder / "results/paper")


def test_a_run_that_fails_is_reported_and_the_others_are_used(first, folder):
    assert first.returncode == 1 and "wild" in first.stderr and "time_step_factor" in first.stderr
    output = folder / "results/paper"
    assert {file.name for file in (output / "runs").iterdir()} == {"cv-dense.run.nc"}
    there = {file.name for file in output.iterdir()}
    assert {*TABLES, *OF_CONTACTS, *OF_RUNS, *OTHERS, "report.html", "calibrated.json"} <= there
    assert "tables:" in first.stdout and "drawing fig" in first.stdout  # progress
    printed = pandas.read_csv(output / "printed_force.csv")
    assert printed["corrected_over_defined"].to_numpy() == pytest.approx(1.0)  # the missing factor is (D*/D)^2
    costs = pandas.read_csv(output / "campaign.csv")
    assert set(costs["threads"]) == {1} and (costs["grain_steps"] == costs["steps"] * costs["grains"]).all()
    assert "cv-dense" in (output / "report.html").read_text()


def test_finished_runs_are_not_repeated_and_their_tables_stay_the_same(first, folder):
    campaign, output = folder / "campaign", folder / "results/paper"
    ran = {file: file.stat().st_mtime_ns for at in (campaign / "runs", output / "runs") for file in at.iterdir()}
    tables = {name: (output / name).read_bytes() for name in TABLES}
    (campaign / "campaign.yaml").write_text(CAMPAIGN)
    assert simulate(str(campaign), 1, lambda fraction, text: None, campaign / "campaign.yaml") == 0
    written = {file.name for file in write_tables(runs(output), output, command="./lab paper")}
    assert {file: file.stat().st_mtime_ns for file in ran} == ran
    assert written >= {*TABLES} - {"campaign.csv"}
    assert {name: (output / name).read_bytes() for name in TABLES} == tables
