"""Cycles, pore pressure and liquefaction: their definitions, and `labkit info`."""

import dataclasses
import re

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.paths.facts import double_amplitude, number_of_cycles
from labkit.results.info import describe_file, run_summary
from labkit.simulation.tasks import RunTask
from tests.stopped import run_stopped

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(liquefied_file):
    return lk.open_run(liquefied_file)


def test_legs_are_half_cycles_and_the_stress_counts_within_them():
    path = lk.paths.UndrainedCycles(amplitude=10.0e3, cycles=2)
    q = 1e3 * np.array([0.0, 5, 10, 0, -10, 0, 10, 4, 6, -2])  # the last leg is incomplete and contains a setback
    axial = np.array([0.0, 1, 2, 1, -1, 0, 1, 0.5, 0.2, -0.5]) * 1e-3
    stress, strain = np.zeros((10, 3, 3)), np.zeros((10, 3, 3))
    stress[:, 2, 2], strain[:, 2, 2] = q, axial
    measure = path.strain_measure()
    assert list(measure.reversals(strain)) == [2, 4, 6]
    cycles = number_of_cycles(path, measure, strain, stress)
    np.testing.assert_allclose(cycles, [0.0, 0.125, 0.25, 0.5, 0.75, 1.0, 1.25, 1.4, 1.4, 1.55])
    assert number_of_cycles(None, measure, strain, stress)[[2, 4, 6]] == pytest.approx([0.25, 0.75, 1.25])
    np.testing.assert_allclose(double_amplitude(measure, strain)[[2, 4, 5, 6]], [2e-3, 3e-3, 1e-3, 2e-3])


def test_a_first_step_that_is_no_quarter_counts_its_share():
    """Cycles go on from a stress between their amplitudes; beyond the first, nothing is counted (ASTM D5311)."""
    path, strain = lk.paths.UndrainedCycles(amplitude=10.0e3, cycles=1), np.zeros((3, 3, 3))
    strain[:, 2, 2] = [0.0, 1e-3, 0.0]
    for start, peak in ((5.0e3, 0.125), (10.0e3, 0.0)):
        stress = np.zeros((3, 3, 3))
        stress[:, 2, 2] = [start, 10.0e3, -10.0e3]
        cycles = number_of_cycles(path, path.strain_measure(), strain, stress, undrained_stress=1e5 * np.eye(3))
        np.testing.assert_allclose(cycles, [0.0, peak, peak + 0.5])


def test_pore_pressure_is_total_minus_effective_stress(run):
    p, stress = run.lab.mean_stress().values, run["stress"].values
    np.testing.assert_allclose(run.lab.pore_pressure(), p[0] - p)
    np.testing.assert_allclose(run.lab.pore_pressure_ratio(), 1.0 - p / p[0])
    cell = 0.5 * (stress[:, 0, 0] + stress[:, 1, 1])
    np.testing.assert_allclose(run.lab.pore_pressure("radial"), cell[0] - cell)  # constant cell pressure
    q = run.lab.deviatoric_stress().values
    np.testing.assert_allclose(run.lab.pore_pressure("radial"), run.lab.pore_pressure() + (q - q[0]) / 3.0)
    with pytest.raises(InputError, match=r"'pore_pressure_back' is unknown.* pore_pressure_radial"):
        run.lab.pore_pressure("back")


def test_liquefaction_is_found_by_both_criteria(run):
    found, cycles = run.lab.liquefaction(), run.lab.cycles().values
    assert 0.5 < found.cycles_to_ratio <= found.cycles == cycles[-1]
    before = cycles < found.cycles_to_ratio
    assert (run.lab.pore_pressure_ratio().values[before] <= 0.95).all() and found.largest_ratio > 0.99
    assert (run.lab.double_amplitude().values[cycles < found.cycles_to_double_amplitude] < 0.05).all()
    assert found.largest_double_amplitude >= 0.05 and (np.diff(cycles) >= 0.0).all()


def test_a_test_that_does_not_liquefy_has_no_number_of_cycles(run):
    early = run.isel(time=run.lab.cycles().values < 1.0)
    found = early.lab.liquefaction()
    assert np.isnan(found.cycles_to_ratio) and np.isnan(found.cycles_to_double_amplitude) and found.largest_ratio < 0.95


def test_info_gives_the_end_of_a_run(run, liquefied_file, shear_file, run_file):
    text = describe_file(liquefied_file)
    for name in ("cycles to r_u > 0.95", "largest double amplitude", "ended_because"):
        assert name in text
    assert f"{run.lab.liquefaction().cycles_to_ratio:.6g}" in text
    assert re.search(r"shear strain gamma_xz +(19|20)\.", describe_file(shear_file))
    assert "axial strain             2.0000%" in describe_file(run_file)
    assert dataclasses.is_dataclass(run.lab.liquefaction())


def test_quantities_of_simple_shear(shear_file):
    run = lk.open_run(shear_file)
    stress = run["stress"].values
    assert run.lab.strain().long_name == "shear strain gamma_xz" and not run.lab.axisymmetric
    assert float(run.lab.strain()[-1]) == pytest.approx(0.2, rel=0.03)  # rate x time, apart from the change of height
    np.testing.assert_allclose(run.lab.q(), lk.micro.equivalent_stress(stress))
    assert float(run.lab.q()[-1]) > 2.0 * abs(float(run.lab.deviatoric_stress()[-1]))
    terms = run.lab.strength_shares().sum("term").values[1:]
    np.testing.assert_allclose(terms, run.lab.stress_ratio("stress_sff").values[1:], rtol=0.02)
    assert float(run.lab.component("contact_anisotropy")[-1]) > 0.1
    assert run.lab.abscissa().name == "strain" and float(run.lab.contact_changes()["accumulated_strain"][-1]) > 0.19


def test_r_u_of_a_run_that_goes_on_refers_to_the_start_of_undrained_loading(soft_specimen, tmp_path):
    """One undrained test in one piece, and in two: through files, in memory, and as conditions."""
    path, options = lk.paths.ConstantVolume(strain=0.01), {"progress": False, "record_strain": 1e-3, "save_every": 1}
    whole = lk.run(soft_specimen, lk.paths.ConstantVolume(strain=0.02), **options)
    expected = whole.data.lab.pore_pressure_ratio()[10:].values
    for file in (None, tmp_path / "first.run.nc"):
        first = lk.run(soft_specimen, path, file=file, **options)
        second = lk.run(first.state, path, **options)
        np.testing.assert_allclose(second.data.lab.pore_pressure_ratio(), expected, rtol=1e-9, atol=1e-9)
        assert abs(expected[0]) > 0.01
    rises = expected[5] > expected[0]
    level = float(0.5 * (expected[0] + expected[5]))
    reached = int(np.argmax(expected > level if rises else expected < level))
    end = lk.run(first.state, path, stop_when=f"r_u {'>' if rises else '<'} {level:.9f}", **options)
    assert len(end.data["time"]) == reached + 1 and end.met_conditions[0].startswith("it ended when r_u")
    shown = run_summary(second.data)["r_u refers to"]
    assert shown == f"p = {float(whole.data.lab.mean_stress()[0]):.6g} Pa, before this run"


def test_r_u_starts_anew_after_drainage_and_at_rest(soft_specimen):
    undrained = lk.paths.ConstantVolume(strain=0.01)
    first = lk.run(soft_specimen, undrained, progress=False)
    drained = lk.run(first.state, lk.paths.IsotropicCompression(strain=0.002), progress=False)
    for state in (first.state.at_rest(), drained.state):
        assert not any(state.undrained_stress)
        again = lk.run(state, undrained, progress=False)
        assert again.data.lab.pore_pressure_ratio()[0] == 0.0


def test_a_resumed_run_keeps_the_start_of_undrained_loading(soft_specimen, tmp_path):
    path, options = lk.paths.ConstantVolume(strain=0.01), {"record_strain": 1e-3, "save_every": 1}
    first = lk.run(soft_specimen, path, progress=False, **options)
    file = tmp_path / "r.run.nc"
    run_stopped(0.5, first.state, path, file=file, **options)
    second = lk.run(first.state, path, file=file, progress=False, **options)
    p = first.data.lab.mean_stress().values[0]
    np.testing.assert_allclose(second.data.lab.pore_pressure_ratio(), 1.0 - second.data.lab.mean_stress() / p)


def test_an_anisotropic_stress_that_a_path_loses_is_named(soft_specimen):
    """Neither a test that goes on from the stress, nor a specimen that was never sheared, is warned of."""
    first = lk.run(soft_specimen, lk.paths.ConstantVolume(strain=0.02), progress=False)
    q, p = float(first.data.lab.q()[-1]) / 1e3, float(first.data.lab.mean_stress()[-1]) / 1e3
    held = lk.paths.ConstantRadialStress(pressure="90 kPa", strain=0.001)
    task = RunTask(state=first.state, path=held, options=lk.Options())
    assert f"p = {p:.4g} kPa, and cr first consolidates isotropically to 90 kPa" in task.warning and q > 0.05 * p
    for state, path in ((first.state, lk.paths.ConstantVolume()), (soft_specimen, held)):
        assert "isotropically" not in (RunTask(state=state, path=path, options=lk.Options()).warning or "")
