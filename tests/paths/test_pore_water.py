"""Undrained tests with pore water of a bulk modulus K_w: constant volume and the drained test are its limits."""

import dataclasses
from typing import ClassVar

import numpy as np
import pytest

import labkit as lk
from labkit.cli.dispatch import main
from labkit.errors import InputError
from labkit.micro.stress import mean_stress
from labkit.model import Model, drive, isotropic_state
from labkit.paths.control import Control, Water
from labkit.paths.step import Step, StrainReached
from labkit.quantities.scalars import TOTAL
from labkit.specimens import skempton_b
from tests.stopped import run_stopped

CV, CYCLES = lk.paths.ConstantVolume, lk.paths.UndrainedCycles
OPTIONS = {"progress": False, "save_every": 1, "record_strain": 5e-4}
AIRY = 5e7  # Pa, water with air


def excess(data, water):
    """u = K_w/n ln(V_0/V) since the first record."""
    e = float(data["void_ratio"].values[0])
    return water * (1.0 + e) / e * np.log(data["volume"].values[0] / data["volume"].values)


def held_total(data, total, water):
    return TOTAL[total](data["stress"].values) + excess(data, water)


def grains(specimen, **path):
    return lk.run(specimen, CV(**path), **OPTIONS).data


def test_the_stiffer_the_water_the_closer_to_constant_volume(loose_specimen):
    """The difference falls as 1/K_w, until rounding errors have grown."""

    def stress(water):
        path = CV(strain=2.5e-4, water=water)
        return lk.run(loose_specimen, path, **{**OPTIONS, "record_strain": 2.5e-4}).data["stress"].values

    limit = stress(None)
    differences = [np.abs(stress(water) - limit).max() for water in (1e10, 1e11, 1e12)]
    assert differences[0] > 0.1
    np.testing.assert_allclose(np.divide(differences[:-1], differences[1:]), 10.0, rtol=0.4)


@pytest.mark.parametrize("total", TOTAL)
@pytest.mark.parametrize("strain", [0.01, -0.01])
def test_the_total_stress_stays_and_u_is_what_the_water_carries(soft_specimen, total, strain):
    data = grains(soft_specimen, strain=strain, water=AIRY, total=total)
    p = float(data.lab.mean_stress()[0])
    assert np.abs(np.diff(data["volume"].values)).max() > 0.0
    np.testing.assert_allclose(held_total(data, total, AIRY), TOTAL[total](data["stress"].values[0]), atol=5e-3 * p)
    np.testing.assert_allclose(data.lab.pore_pressure(), excess(data, AIRY), atol=5e-3 * p)
    ratio = data.lab.quantity("r_u") * TOTAL[total](data["stress"].values[0])
    np.testing.assert_allclose(ratio, data.lab.quantity(f"pore_pressure_{total}"))
    assert np.abs(data["energy_balance_error"].values).max() < 5e-3


def test_without_stiffness_the_test_is_the_drained_one(soft_specimen):
    data = grains(soft_specimen, strain=0.01, water=0.0)
    p = float(data.lab.mean_stress()[0])
    drained = lk.run(soft_specimen, lk.paths.ConstantMeanStress(strain=0.01, pressure=p), **OPTIONS).data
    np.testing.assert_allclose(data["stress"].values, drained["stress"].values, atol=5e-3 * p)
    np.testing.assert_allclose(data["void_ratio"].values, drained["void_ratio"].values, atol=2e-5)
    assert np.ptp(data["void_ratio"].values) > 1e-4


@dataclasses.dataclass(frozen=True)
class IsotropicTotal(lk.Path):
    """Raises the total mean stress by a hundredth, undrained."""

    strain: float = 2e-3
    modulus: float = AIRY

    name: ClassVar[str] = "isotropic_total"
    direction = (0.0, 0.0, 0.0)
    record_strain = 2e-4

    def steps_from(self, start):
        (volume, e), p = start.pores, float(mean_stress(start.stress))
        water = Water(self.modulus * (1.0 + e) / e, volume)
        control = Control(
            np.full((1, 3), 1 / 3), np.ones((3, 1)), lambda t: [p * (1.0 + 0.01 * t / self.strain)], water=water
        )
        yield Step(np.zeros((3, 3)), control, StrainReached(self.strain, self.strain))


def test_b_is_skemptons_with_the_skeleton_as_measured(soft_specimen):
    snapshot = soft_specimen.snapshot()
    loaded = lk.run(soft_specimen, IsotropicTotal(), progress=False).data
    p = loaded.lab.mean_stress().values
    compressed = lk.run(soft_specimen, lk.paths.IsotropicCompression(pressure=1.01 * float(p[0])), progress=False).data
    strain = np.log(compressed["volume"].values[0] / compressed["volume"].values[-1])
    skeleton = float(np.ptp(compressed.lab.mean_stress().values)) / strain
    e = float(loaded["void_ratio"].values[0])
    b = excess(loaded, AIRY)[-1] / (0.01 * p[0])
    assert b == pytest.approx(1.0 / (1.0 + e / (1.0 + e) * skeleton / AIRY), abs=0.02)
    assert skempton_b(snapshot, AIRY) < b < 0.95


@pytest.mark.parametrize("total", ["mean", "radial"])
def test_cycles_keep_the_total_stress_through_reversals(soft_specimen, total):
    data = lk.run(soft_specimen, CYCLES(amplitude=20e3, cycles=2, water=2.2e9, total=total), **OPTIONS).data
    p = float(data.lab.mean_stress()[0])
    assert float(data.lab.cycles()[-1]) == pytest.approx(1.75, abs=0.01)
    np.testing.assert_allclose(held_total(data, total, 2.2e9), TOTAL[total](data["stress"].values[0]), atol=5e-3 * p)


def test_a_run_that_goes_on_keeps_the_total_stress_and_its_reference(soft_specimen):
    first = lk.run(soft_specimen, CV(strain=0.005, water=AIRY, total="radial"), **OPTIONS)
    second = lk.run(first.state, CV(strain=0.005, water=AIRY, total="radial"), **OPTIONS).data
    whole = grains(soft_specimen, strain=0.01, water=AIRY, total="radial")
    p = float(whole.lab.mean_stress()[0])
    u = second.lab.pore_pressure()
    assert float(u[0]) == pytest.approx(float(first.data.lab.pore_pressure()[-1]))
    np.testing.assert_allclose(u, whole.lab.pore_pressure()[10:], atol=5e-3 * p)


def test_a_stopped_run_ends_with_the_bits_of_one_in_one_piece(soft_specimen, tmp_path):
    path, file = CYCLES(amplitude=20e3, cycles=1, water=2.2e8, total="axial"), tmp_path / "r.run.nc"
    run_stopped(0.3, soft_specimen, path, file=file, **OPTIONS)
    resumed = lk.run(soft_specimen, path, file=file, **OPTIONS).data
    whole = lk.run(soft_specimen, path, file=tmp_path / "w.run.nc", **OPTIONS).data
    for name in ("stress", "cell", "void_ratio", "cell_work"):
        np.testing.assert_array_equal(resumed[name].values, whole[name].values)


def test_the_command_line_says_total_and_verify_judges_it(specimen_file, tmp_path, capsys):
    file = tmp_path / "r.run.nc"
    words = ["--water=2.2GPa", "--total=radial", "--strain=0.02", "--rate=20", "--stop-when=r_u > 0.9"]
    assert main(["run", "cv", str(specimen_file), *words, "-o", str(file)]) == 0
    main(["verify", str(file)])
    assert "held: total radial stress, error RMS" in capsys.readouterr().out
    main(["info", str(file)])
    assert "constant total radial stress" in capsys.readouterr().out
    assert main(["run", "cv", str(specimen_file), "--total=vertical", "-o", str(tmp_path / "x.run.nc")]) == 2
    with pytest.raises(InputError, match="water"):
        CV(water=-1.0)


@pytest.mark.yade
def test_yade_holds_the_same_total_stress(soft_specimen):
    path = CV(strain=0.001, water=AIRY, total="radial")  # rounding grows: 0.5 Pa at 0.1 %, 15 Pa at 0.2 %
    ours, yades = (lk.run(soft_specimen, path, engine=engine, **OPTIONS).data for engine in ("fused", "yade"))
    np.testing.assert_allclose(
        yades["stress"].values, ours["stress"].values, atol=1e-4 * float(ours.lab.mean_stress()[0])
    )


@pytest.mark.parametrize("total", TOTAL)
@pytest.mark.parametrize("strain", [0.03, -0.03])
def test_the_model_has_the_same_limits(total, strain):
    model = Model()
    start = isotropic_state(model, 0.67, 200e3)
    limit = drive(model, CV(strain=strain), start).require()
    differences = []
    for water in (1e10, 1e11, 1e12):
        test = drive(model, CV(strain=strain, water=water, total=total), start).require()
        u = water * 1.67 / 0.67 * np.trace(test.strain, axis1=1, axis2=2)
        np.testing.assert_allclose(TOTAL[total](test.stress) + u, 200e3, atol=1.0)
        differences.append(np.abs(test.stress - limit.stress).max())
    np.testing.assert_allclose(np.divide(differences[:-1], differences[1:]), 10.0, rtol=0.05)


def test_the_model_drains_without_stiffness():
    model = Model()
    start = isotropic_state(model, 0.67, 200e3)
    undrained = drive(model, CV(strain=0.05, water=0.0), start)
    drained = drive(model, lk.paths.ConstantMeanStress(strain=0.05, pressure=200e3), start)
    np.testing.assert_allclose(undrained.stress, drained.stress, atol=1.0)
    np.testing.assert_allclose(undrained.e, drained.e, atol=1e-9)
