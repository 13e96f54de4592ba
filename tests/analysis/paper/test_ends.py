"""Initial and final states of tests, and their extrapolation to infinite strain."""

import numpy as np
import pytest

from analysis.paper.ends import between, blocks, ends, extrapolated, main, matching, sheared, starts
from labkit.paths.registry import accumulated_strain
from labkit.results.critical import critical_states


def relaxing(run, relaxation):
    """The first 40 % of a run, with statistics that decay from twice a value to that value, with a little noise."""
    run = between(run, 0.0, 0.4)
    factor = 1.0 + np.exp(-run["axial_strain"].values / relaxation)
    factor = factor + 1e-4 * np.random.default_rng(0).normal(size=factor.size)
    names = (
        "coordination_number mean_normalised_force void_ratio contact_anisotropy normal_force_anisotropy mobilisation "
        "stress"
    ).split()
    fixed = {name: run[name].values[-1:] * factor.reshape(-1, *(1,) * (run[name].ndim - 1)) for name in names}
    return run.assign({name: (run[name].dims, value) for name, value in fixed.items()})


def test_an_exponential_is_extrapolated_to_its_limit(known):
    run = relaxing(known["cv-medium"], 0.1)
    found = extrapolated({"cv-medium": run}).iloc[0]
    at_end = ends({"cv-medium": run}).iloc[0]
    assert found["relaxation_strain"] == pytest.approx(0.1, rel=0.15)
    for name, values in (("Z", "coordination_number"), ("Lambda", "mean_normalised_force"), ("e", "void_ratio")):
        target = float(known["cv-medium"][values].values[between(known["cv-medium"], 0, 0.4).sizes["time"] - 1])
        assert found[name] == pytest.approx(target, rel=5e-3)
        assert abs(at_end[name] / target - 1.0) > 0.02


def test_ends_are_the_critical_states_of_labkit_critical(known):
    tests = sheared(known, ("cr",))
    assert ends(tests).drop(columns="strain").equals(critical_states(tests).drop(columns="strain"))
    some = blocks("cr_1MPa-loose", tests["cr_1MPa-loose"], 1.2, 1.6)
    assert some["Z"].mean() == pytest.approx(ends(tests).set_index("run")["Z"]["cr_1MPa-loose"], rel=2e-3)


def test_runs_are_chosen_by_their_names(known):
    assert not any(name.startswith(("share", "full")) for name in main(known))
    assert set(matching(known, r"cv-medium(_more-s\d+)?")) == {"cv-medium", "cv-medium_more-s2", "cv-medium_more-s3"}
    assert "cp_start-cyclic_dense" not in sheared(known) and "isoc-dense" not in sheared(known)
    assert len(ends({})) == len(extrapolated({})) == len(starts({})) == 0


def test_starts_and_travelled_strain(known):
    found = starts(known).set_index("run")
    assert found["e_made"]["cyclic-cyclic_loose"] == 0.77
    assert found["held_MPa"]["cp_1MPa-dense"] == pytest.approx(1.0, rel=0.02)
    assert np.isnan(found["held_MPa"]["cv-dense"])
    strain = known["cyclic-cyclic_dense"]["axial_strain"].values
    assert accumulated_strain(strain)[-1] == pytest.approx(0.01 + 0.02 + 0.03 + 0.04 + 0.05 + 0.06 + 0.07)
