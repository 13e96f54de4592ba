"""The comparison of three engines: paired differences, with the scatter of the specimens on fused."""

import numpy as np
import pandas
import pytest

from analysis.three_engines.compare import LABELS, differences, figure, pooled


def measured():
    """Two specimens on fused and LAMMPS, which has q/p 0.01 and 0.03 higher, and one specimen on fused only."""
    rows = []
    for seed, value, excess in ((1, 1.0, 0.01), (2, 1.1, 0.03), (3, 1.2, None)):
        row = {"grains": 500, "path": "cp", "seed": seed, "law": "spring_dashpot", **dict.fromkeys(LABELS, 1.0)}
        rows.append({**row, "engine": "fused", "M": value})
        if excess is not None:
            rows.append({**row, "engine": "lammps", "M": value + excess})
    return pandas.DataFrame(rows)


def test_a_specimen_counts_if_it_is_on_both_engines():
    rows = differences(measured())
    M = rows[rows["quantity"] == "M"].iloc[0]
    assert M["specimens"] == 2 and M["engine"] == "lammps"
    assert M["difference"] == pytest.approx(0.02)
    assert M["interval"] == pytest.approx(12.706 * 0.01, rel=1e-3)  # Student's t of one degree of freedom
    assert M["scatter"] == pytest.approx(0.1)
    assert "p_MPa" not in set(rows["quantity"])  # prescribed


def test_a_specimen_counts_once_over_all_paths():
    both = pandas.concat([measured(), measured().assign(path="cr")])  # each specimen on a second path
    rows = pooled(both).set_index("quantity")
    assert rows.loc["M", "specimens"] == 2 and rows.loc["M", "difference"] == pytest.approx(0.02)
    assert rows.loc["M", "interval"] == pytest.approx(12.706 * 0.01, rel=1e-3)
    assert "p_MPa" not in rows.index and rows.loc["Z", "difference"] == 0.0


def test_the_figure_shows_differences_in_units_of_the_scatter():
    rows = differences(measured())
    panel = figure(rows[rows["quantity"] == "M"]).axes[2]
    drawn = panel.containers[0].lines[0].get_xdata()
    assert np.allclose(drawn, 0.2)
