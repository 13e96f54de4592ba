"""Effects of Z0 and the preparation: cells by name; planted effects are found and none is invented."""

import numpy as np
import pandas
import pytest

from analysis.coordination.study import ASKED, CELLS, cell_of, effects, models
from analysis.initial_fabric.response import MEASURES


def test_the_cell_is_in_the_name_of_a_run():
    names = (
        "made-inserted_500-s911",
        "opened_1-inserted_b_500-s921",
        "made-compressed-s931",
        "opened_3-compressed_b-s941",
    )
    assert tuple(map(cell_of, names)) == CELLS


def planted(of_Z, of_preparation):
    """Five specimens per cell; Z0 as in the pilot."""
    rng, rows = np.random.default_rng(4), []
    for cell, Z0 in zip(CELLS, (4.2, 4.6, 5.2, 4.5), strict=True):
        for _ in range(5):
            compressed, Z, e = int("compressed" in cell), Z0 + rng.normal(0.0, 0.05), 0.725 + rng.normal(0.0, 0.003)
            value = of_Z * Z + of_preparation * compressed - 2.0 * (e - 0.725)
            noisy = {name: value + rng.normal(0.0, 0.01) for name in MEASURES}
            rows.append({"cell": cell, "compressed": compressed, "Z0": Z, "e0": e, **noisy})
    return pandas.DataFrame(rows)


@pytest.mark.parametrize(("of_Z", "of_preparation"), [(0.2, 0.0), (0.0, 0.2)])
def test_planted_effects_are_told_apart(of_Z, of_preparation):
    table = effects(planted(of_Z, of_preparation))
    assert table["comparison"].value_counts().to_dict() == {2: 12, 3: 3, 1: 2}
    asked = table[(table["measure"] == ASKED) & (table["comparison"] == 1)].set_index("effect")
    for effect, true in (("Z0", of_Z), ("compressed", of_preparation)):
        row = asked.loc[effect]
        assert abs(row["difference"] - true) < 1.5 * row["within"] < 0.1
        assert (row["corrected"] < 0.05) == (true != 0.0)


def test_a_curve_in_z0_looks_like_an_interaction_but_not_within_cells():
    found = planted(0.2, 0.0)
    found[ASKED] += 0.3 * (found["Z0"] - found["Z0"].mean()) ** 2
    table = models(found).set_index("model")
    assert table.loc["with Z0 x preparation", "added"] < 1e-3 and table.loc["with Z0 squared", "added"] < 1e-6
    assert table["residual"].idxmin() == "with Z0 squared"
    curved, inside = table.loc["with Z0 squared"], table.loc["within cells"]
    assert abs(curved["Z0"] - 0.2) < 1.5 * curved["within"] < 0.05
    assert inside["within"] > 3.0 * curved["within"] and abs(inside["Z0"] - 0.2) < 2.0 * inside["within"]
