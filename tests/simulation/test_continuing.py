"""Continuing a run: exactly from its end, at rest from a snapshot, on every engine and from every command."""

import json
from contextlib import nullcontext

import numpy as np
import pytest

import labkit as lk
from labkit.cli.dispatch import main
from labkit.errors import LabkitWarning
from labkit.grains.state import state_of_snapshot

DRAINED = lk.paths.ConstantRadialStress
OPTIONS = {"progress": False, "save_every": 1, "record_strain": 1e-3}


@pytest.fixture(scope="module")
def halves(soft_specimen, tmp_path_factory):
    """A drained test in one piece; its first half, in a file."""
    file = tmp_path_factory.mktemp("halves") / "first.run.nc"
    whole = lk.run(soft_specimen, DRAINED(strain=0.01, pressure=1e5), **OPTIONS)
    return whole, lk.run(soft_specimen, DRAINED(strain=0.005, pressure=1e5), file=file, **OPTIONS)


def stresses(run):
    return run.data["stress"].values


def test_the_second_half_has_the_bits_of_the_whole(halves, soft_specimen, tmp_path):
    whole, first = halves
    in_memory = lk.run(soft_specimen, DRAINED(strain=0.005, pressure=1e5), **OPTIONS)
    file = tmp_path / "second.run.nc"
    for state in (first.state, in_memory.state, lk.read_state(first.file)):
        second = lk.run(state, DRAINED(strain=0.005, pressure=1e5), **OPTIONS)
        np.testing.assert_array_equal(stresses(second), stresses(whole)[5:])
        for name in ("position", "velocity", "tangential_force", "cell"):
            np.testing.assert_array_equal(getattr(second.state, name), getattr(whole.state, name))
    words = ["--strain=0.005", "--pressure=100kPa", "--record-strain=1e-3", "--save-every=1", "--engine=fused"]
    assert main(["run", "cr", str(first.file), *words, "-o", str(file)]) == 0
    second = lk.Run.open(file)
    np.testing.assert_array_equal(stresses(second), stresses(whole)[5:])
    assert second.provenance["inputs"][0]["file"].endswith("first.run.nc")
    assert main(["info", str(file), "--check"]) == 0


def test_without_a_pressure_a_path_holds_the_stress_that_is_there(halves):
    """The radial stress of a sheared specimen is not its mean stress; the servo of a test leaves it within 1 %."""
    run = lk.run(halves[1].state, DRAINED(strain=-0.002), **OPTIONS)
    pressure = json.loads(run.data.attrs["path_parameters"])["pressure"]
    assert pressure == pytest.approx(1e5, rel=0.01)
    np.testing.assert_array_equal(stresses(run)[0], stresses(halves[1])[-1])
    assert stresses(run)[-1, 2, 2] < 0.9 * stresses(run)[0, 2, 2]


def test_at_another_pressure_or_at_rest_it_is_consolidated(halves):
    loses_q = pytest.warns(LabkitWarning, match="cr first consolidates isotropically to 200 kPa")
    for state, pressure, said in ((halves[1].state, 2e5, loses_q), (halves[1].state.at_rest(), 1e5, nullcontext())):
        with said:
            run = lk.run(state, DRAINED(strain=0.001, pressure=pressure), progress=False, snapshots=0)
        np.testing.assert_allclose(np.diagonal(stresses(run)[0]), pressure, rtol=2e-3)


def test_a_snapshot_has_its_contacts_and_no_velocities(halves, tmp_path, capsys):
    first = halves[1]
    state = lk.read_state(first.file, snapshot=2)
    for one in (state, state_of_snapshot(first.snapshots[2])):
        np.testing.assert_allclose(lk.love_stress(one.snapshot()), stresses(first)[2], rtol=1e-12)
        assert one.step > 0
        assert not one.velocity.any()
    last = state_of_snapshot(first.snapshots[-1])
    for name in ("position", "cell", "contact_grain", "contact_shift", "tangential_force", "rolling_moment"):
        np.testing.assert_array_equal(getattr(last, name), getattr(first.state, name))
    np.testing.assert_array_equal(lk.read_state(first.file, snapshot=-1).velocity, first.state.velocity)
    data = lk.open_state(first.file, 2)
    np.testing.assert_array_equal(data["tangential_force"].values, state.tangential_force)
    assert lk.open_state(first.file)["velocity"].values.any()
    file = tmp_path / "branch.run.nc"
    words = ["--from-snapshot=2", "--strain=0.002", "--engine=fused", "-o", str(file)]
    assert main(["run", "cv", str(first.file), *words]) == 0
    np.testing.assert_allclose(stresses(lk.Run.open(file))[0], stresses(first)[2], rtol=1e-9)
    with pytest.raises(lk.InputError, match=r"snapshot 9 is not in .*, which has 6: give a number from 0 to 5"):
        lk.read_state(first.file, snapshot=9)
    assert main(["consolidate", str(tmp_path / "s.state.nc"), "--pressure=1MPa", "--from-snapshot=0"]) == 2
    assert "labkit: snapshot 0 is for run files" in capsys.readouterr().err


def test_every_command_takes_a_run_file(halves, tmp_path):
    file = str(halves[1].file)
    state, probes = str(tmp_path / "c.state.nc"), str(tmp_path / "p.probes.nc")
    assert main(["consolidate", file, "--pressure=150kPa", "--engine=fused", "-o", state]) == 0
    assert lk.mean_stress(lk.love_stress(lk.read_state(state).snapshot())) == pytest.approx(1.5e5, rel=2e-3)
    assert main(["probe", file, "--from-snapshot=1", "--directions=2", "--engine=fused", "-o", probes]) == 0
    assert main(["export", file, "--snapshot=1", "-o", str(tmp_path / "s.data")]) == 0
    assert main(["picture", file, "-o", str(tmp_path / "p.png")]) == 0
    assert main(["grading", file, "-o", str(tmp_path / "g.png")]) == 0
    test = tmp_path / "test.inp"
    test.write_text("out.txt\n*LinearLoad\n10 1 1.0\n*Cartesian\n0 0.0\n0 0.0\n0 -0.001\n0 0\n0 0\n0 0\n*End\n")
    assert main(["driver", str(test), "--on", file, "--engine=fused", "-o", str(tmp_path / "d.run.nc")]) == 0
    np.testing.assert_array_equal(stresses(lk.Run.open(tmp_path / "d.run.nc"))[0], stresses(halves[1])[-1])


def test_a_failure_keeps_the_records(soft_specimen, tmp_path):
    path = lk.paths.StressRotation(pressure=1e5, stress_ratio=1.4, strain=0.05, rate=50.0)
    for file in (None, tmp_path / "r.run.nc"):
        with pytest.raises(lk.PhysicsError, match=r"^sigma") as error:
            lk.run(soft_specimen, path, file=file, progress=False)
        run = error.value.run
        assert str(error.value).endswith("`run` of this error" if file is None else f"{file} (complete = 0)")
        assert run.data.sizes["time"] > 1
        assert not run.complete
        assert run.state.step > 0
        assert len(run.snapshots) > 1
    (outcome,) = lk.run_many([(soft_specimen, path)], progress=False)
    assert outcome.run.data.sizes["time"] > 1 and outcome.failure.startswith("sigma")
    assert "`run`" not in outcome.failure


@pytest.mark.slow
@pytest.mark.yade
def test_a_run_of_yade_goes_on_in_yade_and_in_fused(run_file, tmp_path):
    for engine, tolerance in (("yade", 1e-6), ("fused", 1e-6)):
        run = lk.run(lk.read_state(run_file), lk.paths.ConstantVolume(strain=0.001), engine=engine, progress=False)
        np.testing.assert_allclose(stresses(run)[0], lk.open_run(run_file)["stress"].values[-1], rtol=tolerance)
        assert run.data["kinetic_energy"].values[0] == pytest.approx(
            lk.open_run(run_file)["kinetic_energy"].values[-1], rel=1e-6
        )
