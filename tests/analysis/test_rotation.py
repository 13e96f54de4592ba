"""Rotation at the critical state: the path turns the stress, planted differences are found, real runs are gathered."""

import shutil
from pathlib import Path

import numpy as np
import pandas
import pytest

import labkit as lk
from analysis.places import results_folder
from analysis.rotation.path import CriticalRotation
from analysis.rotation.study import SECOND, STUDY, differences

pytestmark = pytest.mark.long


def test_the_stress_turns_at_constant_p_and_stays_that_of_triaxial_compression():
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=200, step1_friction=0.12, seed=1), lk.Scene())
    first = lk.run(state, lk.paths.ConstantMeanStress(pressure="500 kPa", strain=0.02, rate=100))
    path = CriticalRotation(pressure="500 kPa", strain=0.08, rotation=90, rotation_strain=0.06, rate=100)
    stress = lk.run(first.state, path).data["stress"].values[-10:].mean(axis=0)
    sizes, axes = np.linalg.eigh(stress / lk.mean_stress(stress))
    assert lk.mean_stress(stress) == pytest.approx(500e3, rel=2e-3)
    assert abs(axes[0, 2]) > 0.999  # sigma_1 along x
    assert sizes[1] - sizes[0] < 0.02 < 0.3 < sizes[2] - sizes[1]


def planted(change):
    """Six specimens, whose e and Z change while they turn; both packings of a pair are the same."""
    rng = np.random.default_rng(5)
    rows = []
    for seed in range(6):
        e = 0.7 + rng.normal(0.0, 0.01)
        for test in ("straight", "turned"):
            for strain in np.arange(0.005, 0.8, 0.01):
                turned = change * (test == "turned" and strain < 0.5)
                values = {name: 1.0 + rng.normal(0.0, 1e-4) for name in SECOND}
                values |= {"e": e + turned + rng.normal(0.0, 1e-3), "Lambda": 0.01}
                rows.append({"test": test, "specimen": seed, "strain": strain, **values})
    return pandas.DataFrame(rows)


@pytest.mark.parametrize("change", [-0.01, 0.0])
def test_a_planted_change_of_e_is_found_and_none_is_invented(change):
    found = differences(planted(change)).set_index(["comparison", "quantity"])
    asked, after = found.loc[1, "e"], found.loc[4, "e"]
    assert abs(asked["difference"] - change) < 2.0 * asked["within"] < 0.003 and asked["specimens"] == 6
    assert (asked["resolved"], asked["equivalent"]) == (change < 0.0, change == 0.0)
    assert after["equivalent"] and not after["resolved"]
    assert found.loc[2]["equivalent"].all()


def test_curves_are_gathered_from_runs_and_make_tables(tmp_path):
    run = Path(results_folder("paper")) / "runs" / "cv-medium.run.nc"
    files = [tmp_path / f"{test}-critical-s{seed}.run.nc" for test in ("straight", "turned") for seed in (1, 2)]
    for file in files:
        shutil.copy(run, file)
    STUDY.gather(files, tmp_path / STUDY.data, "a command")
    curves = STUDY.read(tmp_path / STUDY.data)
    assert set(curves["specimen"]) == {"s1", "s2"} and curves["strain"].max() == pytest.approx(0.4, abs=0.01)
    assert curves["lag"].abs().max() <= 90.0 and curves["to_critical"].abs().max() <= 1.0 + 1e-9
    assert (differences(curves)["difference"].iloc[:-1] == 0.0).all()
