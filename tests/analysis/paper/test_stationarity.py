"""Slopes at the ends of the tests, values at one void ratio, and the separate errors of C0, in a known campaign."""

import numpy as np
import pytest

from analysis.paper.ends import ends, main, sheared
from analysis.paper.sff_errors import c0_bias, c0_errors
from analysis.paper.specimens import density_of, specimen_of
from analysis.paper.stationarity import components, stationarity

pytestmark = pytest.mark.long


def test_specimens_are_told_from_the_names_of_runs():
    assert specimen_of("cr_1MPa-dense") == specimen_of("cv-dense") == "dense"
    assert specimen_of("cv-medium_more-s2") == "medium_more-s2"
    assert specimen_of("share_cv-yade") == specimen_of("share_cr-paper") == "share"
    assert (
        specimen_of("cv_other-dense_high") == specimen_of("cv_other-dense_high 2") == "dense"
        and density_of("cv_other-dense_high") == "dense"
    )


def test_a_drift_is_found_and_the_critical_state_of_the_model_is_stationary(known):
    tests = sheared(main(known))
    found = stationarity(tests)[1].set_index(["path", "quantity"])
    assert set(found.loc["all"]["verdict"]) == {"stationary"}
    assert found.loc[("all", "M"), "specimens"] == 7 and ("cv", "e") not in found.index
    falling = {
        name: run.assign(
            stress_sff=run["stress_sff"], coordination_number=run["coordination_number"] - run["axial_strain"]
        )
        for name, run in tests.items()
    }
    drifts = stationarity(falling)[1].set_index(["path", "quantity"])
    assert drifts.loc[("all", "Z"), "verdict"] == "drifts"
    assert drifts.loc[("all", "Z"), "slope"] == pytest.approx(-0.1, abs=0.01)
    assert len(stationarity({})[0]) == len(stationarity({})[1]) == 0


def test_components_are_given_at_one_void_ratio(known):
    at_ends = ends(sheared(main(known)))
    line = at_ends.assign(M=0.9 - 0.2 * (at_ends["e"] - 0.67))
    found = components(line).set_index("quantity")
    assert found["value"]["M"] == pytest.approx(0.9) and found["slope"]["M"] == pytest.approx(-0.2)
    assert found["within"]["A_zz"] > 0.0 and (found["specimens"] == 7).all()


def test_a_bias_in_q_is_found_in_every_specimen(known):
    runs = {}
    for name, run in sheared(main(known)).items():
        stress = run["stress"].values
        p = np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        runs[name] = run.assign(stress_sff=(run["stress"].dims, p + 0.98 * (stress - p)))
    found = c0_bias(c0_errors(runs)).set_index(["path", "quantity"])
    assert found.loc[("shear", "q"), "bias"] == pytest.approx(-0.02, abs=1e-6)
    assert found.loc[("shear", "q"), "low"] == 22 and found.loc[("shear", "q"), "specimens"] == 7
    assert found.loc[("shear", "ratio"), "rms"] == pytest.approx(0.02, abs=1e-6)
    assert abs(found.loc[("shear", "p"), "bias"]) < 1e-9
