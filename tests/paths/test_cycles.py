"""Cyclic tests on real grains: amplitudes of strain, stress and q/p, drainage, liquefaction, and how they end."""

import re

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.paths.step import Here
from labkit.results.info import run_summary
from labkit.results.verify import findings
from labkit.simulation.progress import status_of
from tests.stopped import run_stopped

pytestmark = pytest.mark.slow

P, FAST = 1e5, {"progress": False, "snapshots": 2, "record_strain": 5e-4}


def turns(run):
    """Strain of the path, q and sigma_xz at the reversals."""
    at = run.path.strain_measure().reversals(run.data["strain"].values)
    return run.data.lab.strain().values[at], run.data.lab.q().values[at], run.data["stress"].values[at, 0, 2]


def held(run):
    """Names and verdicts of the quantities that the path holds."""
    return {f.name.split(",")[0].removeprefix("held: "): f.holds for f in findings(run.data) if "held" in f.name}


@pytest.mark.parametrize("drained", [True, False])
def test_strain_amplitudes_are_exact_and_the_drainage_is_kept(soft_specimen, drained):
    path = lk.paths.StrainCycles(strain_amplitude=0.003, cycles=2, drained=drained, rate=100.0)
    run = lk.run(soft_specimen, path, **FAST)
    np.testing.assert_allclose(turns(run)[0], [0.003, -0.003, 0.003], atol=2e-5)
    assert run.complete and not run.ended_because
    assert run.data.lab.cycles().values[-1] == pytest.approx(1.75, abs=0.01)  # ASTM D5311
    assert held(run) == ({"mean stress": True} if drained else {"volume": True})


def test_simple_shear_reverses_at_its_stress_or_at_its_strain(soft_specimen):
    stress = lk.run(soft_specimen, lk.paths.ShearCycles(amplitude=15e3, cycles=2, rate=100.0), **FAST)
    np.testing.assert_allclose(turns(stress)[2], [15e3, -15e3, 15e3], rtol=0.05)
    assert held(stress) == {"normal stress": True, "strain in y": True}
    path = lk.paths.ShearCycles(strain_amplitude=0.005, cycles=1, drained=False, rate=100.0, spin=False)
    strain = lk.run(soft_specimen, path, **FAST)
    assert turns(strain)[0] == pytest.approx(0.005, abs=2e-5)
    assert held(strain) == {"volume": True, "strain in y": True}


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("drained", [False, True])
def test_cycles_with_a_static_shear_are_about_it(soft_specimen, side, drained, tmp_path):
    """From an anisotropic state in compression and extension: first peak at N = 0.25; resumed, and continued."""
    shear = lk.paths.ConstantRadialStress(strain=side * 0.02, rate=100.0)
    state = lk.run(soft_specimen, shear, stop_when=f"q {'>' if side > 0 else '<'} {side * 25}kPa", **FAST).state
    kind = lk.paths.DrainedCycles if drained else lk.paths.UndrainedCycles
    path, file = kind(amplitude=8e3, cycles=2, rate=25.0, strain_limit=0.5), tmp_path / "cycles.run.nc"
    run = lk.run(state, path, **FAST, save_every=1)
    q, cycles = run.data.lab.q().values, run.data.lab.cycles().values
    at = run.path.strain_measure().reversals(run.data["strain"].values)
    assert side * q[0] > 20e3
    np.testing.assert_allclose(q[at] - q[0], [8e3, -8e3, 8e3], atol=2e3)
    np.testing.assert_allclose(cycles[[*at, -1]], [0.25, 0.75, 1.25, 1.75], atol=1e-6)
    assert f"about q = {q[0]:.6g} Pa" in run_summary(run.data)["cycles"]

    run_stopped(0.5, state, path, file=file, **FAST, save_every=1)
    resumed = lk.run(state, path, file=file, **FAST, save_every=1)
    np.testing.assert_array_equal(resumed.data["stress"], run.data["stress"])
    if not drained:  # another run goes on with the cycles about the same q
        after = lk.run(run.state, path, **FAST).data
        at = run.path.strain_measure().reversals(after["strain"].values)
        np.testing.assert_allclose(after.lab.q().values[at] - q[0], [8e3, -8e3, 8e3], atol=2e3)


def test_the_levels_of_cycles_follow_the_start():
    """Scatter of an isotropic specimen is no static shear; q/p and sigma_xz cycle about their values too."""

    def levels(path, q=0.0, shear=0.0, **start):
        stress = 1e5 * np.eye(3) + q * np.diag([-1.0, -1.0, 2.0]) / 3.0
        stress[0, 2] = stress[2, 0] = shear
        return [end.level for step in path.steps_from(Here(stress, **start)) for end in step.stress_ends]

    path = lk.paths.UndrainedCycles(amplitude=20e3, cycles=1)
    assert levels(path, 4e3) == [20e3, -20e3]
    assert levels(path, -6e3) == pytest.approx([14e3, -26e3])
    assert levels(lk.paths.UndrainedCycles(amplitude=1e3, cycles=1), 4e3) == pytest.approx([5e3, 3e3])
    assert levels(lk.paths.UndrainedCycles(ratio=0.2, cycles=1), 30e3) == pytest.approx([0.5, 0.1])
    assert levels(lk.paths.ShearCycles(amplitude=15e3, cycles=1, pressure=P), shear=10e3) == pytest.approx([25e3, -5e3])
    assert levels(path, -20e3, undrained=1e5 * np.eye(3)) == [20e3, -20e3]  # goes on from the end of a cycle
    assert levels(path, 58e3, undrained=1e5 * np.eye(3)) == pytest.approx([78e3, 38e3])  # after undrained shear


def test_a_stress_ratio_reverses_an_undrained_test(soft_specimen):
    run = lk.run(soft_specimen, lk.paths.UndrainedCycles(ratio=0.3, cycles=1, rate=100.0), **FAST)
    at = run.path.strain_measure().reversals(run.data["strain"].values)
    assert run.data.lab.stress_ratio().values[[at[0], -1]] == pytest.approx([0.3, -0.3], rel=0.05)


def test_liquefaction_ends_the_test_and_nothing_blows_up_at_zero_pressure(liquefied_file):
    run = lk.Run.open(liquefied_file)
    p = run.data.lab.mean_stress().values
    assert run.complete and p.min() < 0.01 * p[0]
    assert "exceeded strain_limit 0.05 while q was" in run.ended_because and "short of" in run.ended_because
    for name in ("stress", "stress_sff", "strain", "kinetic_energy", "coordination_number", "energy_balance_error"):
        assert np.isfinite(run.data[name].values).all(), name
    assert np.abs(run.data["energy_balance_error"].values).max() < 0.05 and held(run) == {"volume": True}
    assert "inertial number" in [limit.name for limit in run.exceeded]  # the check reports it
    ended = next(finding for finding in findings(run.data) if finding.name.startswith("ended"))
    assert ended.holds and run.ended_because in ended.name


def test_a_specimen_that_carries_no_stress_is_said_to(soft_specimen):
    run = lk.run(soft_specimen, lk.paths.ProportionalStrain(ratios=(1.0, 1.0, 1.0), strain=-0.02, rate=50.0), **FAST)
    assert run.data.lab.mean_stress().values[-1] == 0.0
    (text,) = [str(limit) for limit in run.exceeded if limit.name == "inertial number"]
    assert text.endswith("carries no stress there (p = 0)") and "inf;" not in text


def test_an_amplitude_beyond_the_strength_ends_at_the_strain_limit(soft_specimen):
    path = lk.paths.ShearCycles(amplitude=90e3, cycles=3, rate=300.0, strain_limit=0.03)
    run = lk.run(soft_specimen, path, **FAST)
    assert run.complete and run.data.lab.cycles().values[-1] < 0.5
    assert "gamma_xz 3" in run.ended_because and "sigma_xz was" in run.ended_because and "90 kPa" in run.ended_because


def test_a_path_that_ends_at_its_strain_says_what_it_missed(soft_specimen):
    run = lk.run(soft_specimen, lk.paths.IsotropicCompression(pressure=2e6, strain=0.002, rate=50.0), progress=False)
    assert run.complete and "before the stress of 2000 kPa" in run.ended_because


def test_progress_tells_the_strain_of_the_path_and_the_cycle(soft_specimen):
    texts = []
    path = lk.paths.ShearCycles(strain_amplitude=0.004, cycles=1, rate=100.0)
    lk.run(soft_specimen, path, **{**FAST, "progress": lambda fraction, text: texts.append((fraction, text))})
    assert texts[-1][0] == 1.0
    assert re.fullmatch(r"cycle 1 of 1, shear strain gamma_xz -0\.40%, p \d+(\.\d)? kPa", texts[-1][1])
    record = {"strain": np.diag([0.0, 0.0, 0.01]), "stress": 1e5 * np.eye(3)}
    assert status_of(lk.paths.CyclicConstantMeanStress(pressure=P), record, 1, 7).startswith(
        "step 2 of 7, axial strain 1.00%"
    )
    text = status_of(lk.paths.ConstantMeanStress(pressure=P, strain=-0.05), record, 0, 1)
    assert text == "axial strain 1.00% of -5.00%, p 100.0 kPa"  # what remains
    text = status_of(lk.paths.IsotropicCompression(), record, 0, 1)
    assert text.startswith("volumetric strain 1.00%, p")
    record["stress"] = np.array([[2e5, 0.0, 1e5], [0.0, 2e5, 0.0], [1e5, 0.0, 2e5]])
    text = status_of(lk.paths.StressRotation(pressure=P), record, 0, 1)
    assert text.startswith("sigma_1 at 45 degrees to z, strain |eps|")


def test_one_amplitude_at_a_time():
    with pytest.raises(InputError, match="strain_amplitude and amplitude are both given"):
        lk.paths.ShearCycles(amplitude=1e4, strain_amplitude=0.01)
    assert [step.until.turn for step in lk.paths.ShearCycles(pressure=P).steps_from(Here())][:2] == [0.01, -0.01]
