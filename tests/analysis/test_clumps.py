"""The study of clumps: the identities that its stored data must keep, and its sentence on few specimens."""

from pathlib import Path

from analysis.clumps.questions import STRAINS, judged
from analysis.clumps.study import STUDY
from analysis.places import results_folder

DATA = STUDY.read(Path(results_folder("clumps")) / STUDY.data)


def test_no_error_of_three_specimens_is_below_the_margin():
    of_few, of_all = (judged(DATA[DATA["seed"].isin(range(most)) & (DATA["engine"] == "fused")]) for most in (4, 99))
    assert "below the margin" in set(of_all["outcome"]) - set(of_few["outcome"])


def test_the_stored_errors_are_the_sum_of_their_budget():
    data = DATA[DATA["strain"] >= STRAINS[0]]
    parts = data[[name for name in data if name.startswith("budget ") and name.endswith(" q")]]
    assert len(parts.columns) == 5
    assert (abs(parts.sum(axis=1) - data["M - X q"]) <= 5e-4 * parts.abs().sum(axis=1) + 2e-5).all()
    assert (abs(data["budget equal_stress p"] - data["M - X p"]) <= 1e-3 * data["M - X p"].abs() + 2e-5).all()
    assert set(data["engine"]) == {"fused", "yade"} and data["strain"].between(0.0, 0.3).all()
