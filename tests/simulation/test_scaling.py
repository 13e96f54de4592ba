"""A change of units of force changes no record: E and all stresses times four, twice the rate."""

import dataclasses

import pytest

import labkit as lk

pytestmark = pytest.mark.long

TIMES = 4.0  # E and stresses; a power of two, so that every product is exact


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
