"""Constants of other grains: results computed from planted states, and the scaling of E and p."""

import dataclasses

import numpy as np
import pandas
import pytest

import labkit as lk
from analysis.constants.materials import (
    CONSTANTS,
    MEASURED,
    PAPER,
    cells_of,
    constant_table,
    constants,
    material_of,
    slope_table,
)
from analysis.paper.lines import critical_Lambda, critical_Z

pytestmark = pytest.mark.long

TIMES = 4.0  # E and stresses; a power of two, so that every product is exact


def planted(shift):
    """Ends of specimens on the paper's lines, with e_cmax shifted by `shift` of a material: {material: shift}."""
    rng = np.random.default_rng(3)
    rows = []
    for material, by in shift.items():
        for density, e in (("dense", 0.62), ("loose", 0.72)):
            for seed in range(4):
                at = e + rng.normal(0.0, 0.001)
                state = [at + by, float(critical_Lambda(at)), float(critical_Z(at)), 0.92, 0.45, 0.77, 0.045]
                noise = rng.normal(0.0, 1.0, 7) * [0, 5e-5, 0.01, 0.003, 0.003, 0.003, 2e-4]
                rows.append(
                    {"material": material, "density": density, "seed": seed}
                    | dict(zip(MEASURED, np.add(state, noise), strict=True))
                )
    return pandas.DataFrame(rows)


def test_constants_of_states_on_the_papers_lines():
    e = np.array([0.61, 0.73])
    states = np.column_stack([e, critical_Lambda(e), critical_Z(e), *(np.full(2, x) for x in (0.9, 0.4, 0.8, 0.05))])
    found = dict(zip(CONSTANTS, constants(states), strict=True))
    expected = {"M": 0.9, "e_cmax": 0.76, "c_cLam": 0.098, "c_cZ": 5.57, "gamma_cZ": 0.7, "Lambda_067": 0.00882}
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert material_of("paper_dense_more-s4") == ("paper", "dense")


def test_a_planted_change_is_found_and_no_other():
    cells = cells_of(planted({PAPER: 0.0, "mu020": -0.03, "mu060": 0.03, "kappa4": 0.0}))
    table = constant_table(cells)
    found = table[table["verdict"] == "differs"]
    assert set(zip(found["parameter"], found["value"], found["constant"], strict=True)) == {
        ("mu", value, constant) for value in (0.2, 0.6) for constant in ("e_cmax", "Lambda_067")
    }
    slope = slope_table(cells).set_index(["parameter", "constant"]).loc[("mu", "e_cmax")]
    assert abs(slope["slope"] - 0.15) < slope["within"] < 0.02


def scaled(state):
    """The same state with E and all stresses times TIMES: time runs sqrt(TIMES) times as fast."""
    faster = TIMES**0.5
    return dataclasses.replace(
        state,
        scene=dataclasses.replace(state.scene, young_modulus=TIMES * state.scene.young_modulus),
        velocity=faster * state.velocity,
        angular_velocity=faster * state.angular_velocity,
        velocity_gradient=faster * state.velocity_gradient,
        tangential_force=TIMES * state.tangential_force,
        rolling_moment=TIMES * state.rolling_moment,
        time=state.time / faster,
        time_step=state.time_step / faster,
    )


@pytest.mark.parametrize("path", ["cv", "cp"])
def test_young_modulus_and_pressure_scale_together_to_the_last_bit(path):
    scene = lk.Scene(law="spring_dashpot", time_step_factor=0.3)
    state = lk.make_specimen(lk.Recipe(void_ratio=0.64, step1_friction=0.1, grains=200), scene, progress=False)
    if path == "cp":
        state = lk.consolidate(state, 500e3, progress=False)
    runs = []
    for start, times in ((state, 1.0), (scaled(state), TIMES)):
        rate = 18.0 * times**0.5
        held = {"pressure": 500e3 * times} if path == "cp" else {}
        kind = lk.paths.ConstantMeanStress if path == "cp" else lk.paths.ConstantVolume
        runs.append(lk.run(start, kind(strain=0.008, rate=rate, **held), progress=False).data)
    one, other = runs
    assert (TIMES * one["stress"].values == other["stress"].values).all()
    for name in ("mean_normalised_force", "coordination_number", "contact_anisotropy", "void_ratio", "mobilisation"):
        assert (one[name].values == other[name].values).all(), name
