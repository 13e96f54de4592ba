"""The comparison of contact laws: means, and intervals from the scatter of specimens."""

import numpy as np
import pandas
import pytest

from analysis.laws.compare import RESULTS, VALUES, comparison, page, pooled_comparison


def table(values):
    """(law, density) -> M of the seeds; every other value is 1."""
    rows = [
        {**dict.fromkeys(VALUES, 1.0), "law": law, "density": density, "seed": f"s{k}", "M": M}
        for (law, density), of_seeds in values.items()
        for k, M in enumerate(of_seeds)
    ]
    return pandas.DataFrame(rows)


MADE_UP = table(
    {
        ("linear", "dense"): [0.8, 0.82],
        ("linear", "loose"): [0.7, 0.72],
        ("hertz", "dense"): [0.84, 0.86],
        ("hertz", "loose"): [0.74],
    }
)


def row(compared, density):
    return compared.set_index(["density", "value"]).loc[(density, "M")]


def test_the_scatter_of_seeds_is_pooled_over_laws_and_densities():
    """Three pairs 0.02 apart: s = 0.0141 with three degrees of freedom, t = 3.182."""
    compared = pooled_comparison(MADE_UP)
    dense, loose, both = (row(compared, density) for density in ("dense", "loose", "all"))
    scatter = 3.182 * 0.02 / np.sqrt(2.0)
    assert dense["difference"] == pytest.approx(0.04) and loose["difference"] == pytest.approx(0.03)
    assert dense["difference +-"] == pytest.approx(scatter, rel=1e-3)
    assert loose["hertz +-"] == pytest.approx(scatter, rel=1e-3) and loose["hertz runs"] == 1
    assert both["linear"] == pytest.approx(0.76) and both["difference"] == pytest.approx(0.035)
    assert both["difference +-"] == pytest.approx(scatter * np.sqrt((0.5 + 0.5 + 0.5 + 1.0) / 4.0), rel=1e-3)


def test_single_groups_have_their_own_scatter():
    """Student's t of a pair is 12.706."""
    dense = row(comparison(MADE_UP), "dense")
    assert dense["linear +-"] == pytest.approx(12.706 * 0.01, rel=1e-3)
    assert dense["difference"] == pytest.approx(0.04)


def test_the_stored_page_follows_from_the_stored_tables():
    assert page(RESULTS) == (RESULTS / "README.md").read_text()
