"""Held stresses that cannot reach their targets stop a run with one sentence, and the run file stays valid."""

import numpy as np
import pytest

import labkit as lk
from labkit.errors import PhysicsError
from labkit.paths.element_tests import NORMAL, SHEAR_XZ
from labkit.servo import reach

pytestmark = pytest.mark.slow

SHEAR = lk.paths.Mixed(
    free=[*NORMAL, SHEAR_XZ], measured=[*NORMAL, SHEAR_XZ], target=[1e5, 1e5, 1e5, 9e4], strain=0.02, rate=20.0
)


@pytest.fixture(scope="module", params=["fused", "yade"])
def stopped(request, soft_specimen, tmp_path_factory):
    """(error, run file, engine) of a shear stress beyond the strength."""
    file = tmp_path_factory.mktemp("reach") / f"{request.param}.run.nc"
    with pytest.raises(PhysicsError) as error:
        lk.run(soft_specimen, SHEAR, engine=request.param, file=file, progress=False, snapshots=2)
    return str(error.value), file, request.param


def test_the_sentence_names_the_component_its_target_and_its_value(stopped):
    said, file, _ = stopped
    assert said.startswith("sigma_xz does not reach its target of 90 kPa: it is ") and "choose a target" in said
    run = lk.Run.open(file)
    value = 0.5 * (run.data["stress"].values[-1, 0, 2] + run.data["stress"].values[-1, 2, 0]) / 1e3
    assert f"it is {value:.4g} kPa" in said and f"are in {file} (complete = 0)" in said


def test_the_run_file_stays_valid_and_verify_fails_it(stopped):
    said, file, _ = stopped
    run = lk.Run.open(file)
    assert not run.complete and said.startswith(run.ended_because) and run.ended_because
    assert run.data.sizes["time"] > 3 and run.data["record"].values[-1] == run.data.sizes["time"] - 1
    ended = next(finding for finding in lk.verify(run) if finding.name.startswith("ended: sigma_xz"))
    assert ended.decides and not ended.holds and "FAILED" in str(ended)
    np.testing.assert_allclose(lk.love_stress(run.snapshots[-1]), run.data["stress"].values[-1], rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("stopped", ["fused"], indirect=True)
def test_the_same_command_again_gives_the_same_sentence(stopped, soft_specimen):
    said, file, _ = stopped
    with pytest.raises(PhysicsError) as error:
        lk.run(soft_specimen, SHEAR, file=file, progress=False, snapshots=2)
    assert str(error.value) == said


@pytest.mark.parametrize(
    ("path", "names"),
    [
        (lk.paths.Mixed(free=NORMAL, measured=NORMAL, target=[1e5, 1e5, 5e5], strain=0.02, rate=20.0), "sigma_zz"),
        (lk.paths.Mixed(free=NORMAL, measured=NORMAL, target=[-2e4, 1e5, 1e5], strain=0.02, rate=20.0), "sigma_xx"),
        (lk.paths.StressRotation(pressure=1e5, stress_ratio=1.4, strain=0.05, rate=50.0), "sigma_"),
    ],
)
def test_deviators_beyond_the_strength_tension_and_rotation(soft_specimen, path, names):
    with pytest.raises(PhysicsError, match=rf"^{names}.* `run` "):
        lk.run(soft_specimen, path, progress=False, snapshots=0)


def test_a_target_far_away_is_reached_in_the_end(soft_specimen):
    """In a step from 100 kPa to 1 MPa, the servo is at its limit over many records, but the error falls."""
    path = lk.paths.Mixed(free=NORMAL, measured=NORMAL, target=[1e6] * 3, strain=0.01, rate=10.0)
    run = lk.run(soft_specimen, path, progress=False, snapshots=0)
    assert run.complete
    np.testing.assert_allclose(np.diagonal(run.data["stress"].values[-1]), 1e6, rtol=0.02)


def test_a_lag_grows_only_at_the_limit_without_progress():
    lag = reach.Lag()
    for error in (0.5, 0.4, 0.3, 0.2):  # the stress approaches
        lag = lag.after(0.015, error, True)
        assert not lag.hopeless
    lag = lag.after(0.015, 0.2, True)
    assert lag.strain == 0.015 and not lag.hopeless
    assert lag.after(0.015, 0.21, True).hopeless
    assert lag.after(0.015, 0.21, False) == reach.Lag()  # the servo could do more
    assert lag.after(0.015, 0.01, True) == reach.Lag()  # the error is small
