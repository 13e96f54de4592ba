"""A user's path in several steps, each with its own end: the same walk on grains and on the model."""

import dataclasses

import numpy as np
import pytest

import labkit as lk
from labkit.model import Model, drive, isotropic_state
from labkit.paths import RecordMeets, Step, StrainReached, StressReached
from labkit.paths.path import number_of_steps
from tests.stopped import run_stopped

P, LEVEL, RATIO = 0.3e6, 0.4e6, 0.3
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:at the axial strain rate")]


@lk.register_path
@dataclasses.dataclass(frozen=True)
class ThereAndBack(lk.Path):
    """Isotropic compression to a stress, shear at constant volume to a stress ratio, and some unloading."""

    name = "there_and_back"

    def steps_from(self, start):
        """Each step has another end."""
        shear = np.diag([-0.5, -0.5, 1.0])
        to_level = StressReached("the mean stress", lk.mean_stress, LEVEL)
        yield Step(np.eye(3), None, StrainReached(0.02) | to_level)
        self.seen.append(start.stress.copy())
        yield Step(shear, None, StrainReached(0.05) | RecordMeets(f"q/p > {RATIO}"))
        yield Step(-shear, None, StrainReached(0.004))

    @property
    def seen(self):
        """Stresses at which the second step started."""
        return SEEN


SEEN = []


def ends(strain, stress):
    """Largest axial strain, the number of its record, and q/p at all records."""
    p = np.trace(stress, axis1=1, axis2=2) / 3.0
    q = stress[:, 2, 2] - 0.5 * (stress[:, 0, 0] + stress[:, 1, 1])
    top = int(strain[:, 2, 2].argmax())
    return top, q / p, p


def require_walked(strain, stress, volume_tolerance):
    """The steps ended where they should."""
    top, ratio, p = ends(strain, stress)
    volumetric = np.trace(strain, axis1=1, axis2=2)
    turned = int(np.argmax(np.abs(volumetric - volumetric[-1]) < volume_tolerance))  # the volume is constant from here
    assert p[turned] == pytest.approx(LEVEL, rel=0.02) and p[turned] >= LEVEL * (1.0 - 1e-6)
    assert ratio[top] > RATIO and (ratio[turned:top] <= RATIO).all()
    assert strain[top, 2, 2] - strain[-1, 2, 2] == pytest.approx(0.004, rel=1e-3)


def test_steps_end_at_a_stress_a_record_and_a_strain_on_grains_and_resume(loose_specimen, tmp_path):
    specimen = lk.consolidate(loose_specimen, P, progress=False)
    path = ThereAndBack(rate=50.0)
    assert number_of_steps(path) == 3
    options = {"progress": False, "snapshots": 0, "record_strain": 2e-4, "save_every": 1}
    whole = lk.run(specimen, path, file=tmp_path / "whole.run.nc", **options)
    require_walked(whole.data["strain"].values, whole.data["stress"].values, 1e-9)
    assert lk.mean_stress(SEEN[-1]) == pytest.approx(LEVEL, rel=0.02)

    for share in (0.1, 0.3, 0.6, 0.9):
        file = tmp_path / f"{share}.run.nc"
        run_stopped(share, specimen, path, file=file, **options)
        resumed = lk.run(specimen, path, file=file, **options)
        assert resumed.data.attrs["data_sha256"] == whole.data.attrs["data_sha256"]


def test_the_model_takes_the_same_steps():
    result = drive(Model(), ThereAndBack(), isotropic_state(Model(), 0.67, P), record_strain=2e-4)
    assert result.failure is None and result.endings.reason == ""
    require_walked(result.strain, result.stress, 1e-9)
