"""The study of the equation by volume: its closures, its order, and the identities that its stored data must keep."""

from pathlib import Path

import numpy as np
import pandas
import pytest

from analysis.places import results_folder
from analysis.volume import simulate
from analysis.volume.forms import FORMS, POINTS, WEIGHTS, greatest_entropy, of_snapshot, polynomials
from analysis.volume.questions import by_test, closures, engines, errors, failing, stored
from labkit.sff import NEGLECTED
from tests.contact_sets import make

SNAPSHOTS = Path(results_folder("volume")) / "snapshots.csv.gz"


def test_the_function_of_greatest_entropy_has_the_moments_and_is_positive():
    planted_function = 2.0 * np.exp(POINTS @ np.diag([-0.5, 0.1, 1.2]) @ POINTS.T).diagonal()
    moments = WEIGHTS * planted_function @ polynomials(POINTS)
    found = greatest_entropy(moments)
    assert (found > 0.0).all()
    np.testing.assert_allclose(found, planted_function, rtol=1e-6)


def test_two_terms_leave_only_tangential_forces_of_order_4():
    """Also where few contacts make the density of fourth order, by which `fourth` divides, come near zero."""
    failed = 0
    for seed in range(40):
        row = of_snapshot(make(seed, 40, 40, 5.0, 0.5))
        assert row["c0_volume + 2 q"] == pytest.approx(-row["neglected tangential_4"], abs=1e-9)
        assert row["c0_volume q"] == pytest.approx(-sum(row[f"neglected {name}"] for name in NEGLECTED), abs=1e-9)
        assert abs(row["c0_volume p"]) < 1e-9 > abs(row["c0_volume + 2 p"])
        failed += abs(row["fourth q"]) > 1.0
    assert failed > 0


def test_a_round_is_whole_and_spheres_come_first():
    first, second, third, *_ = simulate.rounds()
    assert [cell.grading for cell in first] == list(simulate.SPHERES) and {cell.shape for cell in first} == {"spheres"}
    assert {cell.seed for cell in second} == {simulate.SEEDS[1]}
    assert {cell.shape for cell in third} == set(simulate.CLUMPS) and {cell.seed for cell in third} == {11}
    others = [of_round for grading in simulate.OTHER_RATIOS for of_round in simulate.rounds_of(grading)]
    assert len({cell.name for of_round in [*simulate.rounds(), *others] for cell in of_round}) == 10 * (7 + 4) + 3 * 12


def test_a_closure_earns_its_place_by_the_rule_of_the_plan():
    """One that is below where c0_volume is not, and everywhere else, and never wild; none of the study does."""
    rng, gradings = np.random.default_rng(2), np.repeat(simulate.SPHERES[:2], 20)
    data = pandas.DataFrame(
        {"shape": "spheres", "grading": gradings, "test": 2 * (10 * ["compression"] + 10 * ["cyclic"])}
    )
    data = data.assign(seed=np.tile(range(10), 4), strain=0.05, **{"q/p": 0.5})
    data = data.assign(
        **{f"{form} q": 0.004 * rng.normal(size=40) for form in FORMS}, **{f"{form} p": 0.0 for form in FORMS}
    )
    wide = data["grading"] == "2 volume"
    data.loc[wide, "c0_volume q"] += 0.04
    data.loc[~wide, "entropy2 q"] += 0.04  # below where c0_volume is not, but not elsewhere
    data.loc[wide, "fourth q"] += 0.07  # wild itself
    rule = closures(errors(data), by_test(data), failing(data)).set_index("form")
    assert rule["earned"].to_dict() == {"fourth": False, "entropy2": False, "c0_volume + 2": True}
    assert rule.loc["c0_volume + 2", ["missed", "cured", "reached", "still"]].tolist() == [4, 4, 2, 2]
    assert not closures(errors(data), by_test(data), failing(data).assign(**{"c0_volume + 2 q": 0.06}))["earned"].any()


def test_engines_are_alike_if_they_differ_by_less_than_the_plan_allows():
    fused = pandas.read_csv(SNAPSHOTS)[lambda data: data["shape"] == "spheres"].assign(engine="fused")
    for more, alike in ((0.001, True), (0.006, False)):
        yade = fused.assign(engine="yade", **{"c0_volume q": fused["c0_volume q"] + more})
        table = engines(pandas.concat([fused, yade]))
        assert np.allclose(table["difference"], more) and (table["alike"] == alike).all()


def test_the_stored_snapshots_keep_the_identities():
    data = pandas.read_csv(SNAPSHOTS)
    assert data["c0_volume p"].abs().max() < 1e-6 and data["c0 p"].abs().max() > 0.2
    total = data["c0_volume q"] + sum(data[f"neglected {name}"] for name in NEGLECTED)
    assert total[data["q/p"] > 0.2].abs().max() < 1e-3  # stored to five digits
    assert stored()["largest_error_of_p"].max() < 1e-6
