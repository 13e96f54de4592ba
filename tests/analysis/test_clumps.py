"""The study of clumps: its sentences on planted data, and the identities that its stored data must keep."""

from pathlib import Path

import numpy as np
import pandas
import pytest

from analysis.clumps.forms import FORMS, UNPLANNED
from analysis.clumps.questions import COMPONENTS, LENGTH, STRAINS, eccentricity, engines, judged, rate_law, steps
from analysis.clumps.study import STUDY
from analysis.places import results_folder


def planted(shift=0.0, scatter=0.001, engine="fused", forms=FORMS + UNPLANNED):
    """Snapshots of five rods in compression; the error of q is 3 % in the first form and 0.1 % in all others."""
    rows = []
    for seed in range(1, 6):
        for strain in (0.05, 0.1, 0.15):
            row = {"shape": "rods15", "test": "compression", "seed": seed, "engine": engine, "strain": strain}
            for form in forms:
                size = (0.03 if form == forms[0] else 0.001) + shift + scatter * (seed - 3)
                row |= {f"{form} {component}": size for component in COMPONENTS}
            rows.append(row)
    return pandas.DataFrame(rows)


def outcomes_of(data):
    return judged(data)[lambda table: table["component"] == "q"].set_index("form")["outcome"].to_dict()


def test_a_form_is_judged_by_its_interval_over_the_specimens():
    assert outcomes_of(planted(scatter=1e-4)) == dict.fromkeys(FORMS + UNPLANNED, "below the margin") | {
        "printed": "above the margin"
    }
    assert set(outcomes_of(planted(scatter=0.02)).values()) == {"not resolved"}
    few = planted(scatter=1e-4)[lambda data: data["seed"] < 4]
    assert "below the margin" not in outcomes_of(few).values()


def test_a_step_matters_by_its_size_whatever_the_scatter_of_the_specimens():
    table = steps(planted(scatter=0.05)).set_index(["from", "to"])
    assert table["matters"].to_dict() == {
        ("printed", "l.n"): True,
        ("l.n", "M"): False,
        ("M", "M - X"): False,
        ("M", "G"): False,
    }
    assert table.loc[("printed", "l.n"), "change"] == pytest.approx(-0.029)


def test_engines_are_compared_specimen_by_specimen():
    yade = planted(shift=0.002, scatter=0.05, engine="yade")[lambda data: data["seed"] < 4]
    table = engines(pandas.concat([planted(scatter=0.05), yade])).set_index("component")
    assert table["difference"].to_numpy() == pytest.approx(0.002)
    assert set(table["outcome"]) == {"the same"}


def test_the_rate_law_finds_its_planted_constants_and_fails_in_a_test_with_others():
    rows = []
    for test, end in (("compression", -0.1), ("shear", -0.1), ("extension", 0.3)):
        for seed in range(1, 6):
            strain, start = np.linspace(0.0, 0.3, 31), 0.01 * seed
            G = eccentricity((strain * LENGTH[test], start), 4.0, end)
            rows.append(pandas.DataFrame({"strain": strain, "G": G, "q/p": 1.0, "seed": seed, "test": test}))
    table = rate_law(pandas.concat(rows).assign(shape="rods15")).set_index("test")
    assert table["c"].to_numpy() == pytest.approx(4.0, rel=1e-3) and table["end"].to_numpy() == pytest.approx(-0.1)
    assert table["holds"].to_dict() == {"compression": True, "shear": True, "extension": False}


def test_the_stored_errors_are_the_sum_of_their_budget():
    data = STUDY.read(Path(results_folder("clumps")) / STUDY.data)[lambda table: table["strain"] >= STRAINS[0]]
    parts = data[[name for name in data if name.startswith("budget ") and name.endswith(" q")]]
    assert len(parts.columns) == 5
    assert (abs(parts.sum(axis=1) - data["M - X q"]) <= 5e-4 * parts.abs().sum(axis=1) + 2e-5).all()
    assert (abs(data["budget equal_stress p"] - data["M - X p"]) <= 1e-3 * data["M - X p"].abs() + 2e-5).all()
    assert set(data["engine"]) == {"fused", "yade"} and data["strain"].between(0.0, 0.3).all()
