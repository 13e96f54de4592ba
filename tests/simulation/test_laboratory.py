"""The Python interface: specimens, consolidation and tests, on both engines."""

import inspect
import os
import signal
import subprocess
import sys
import tempfile
import threading

import netCDF4
import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure

import labkit as lk
from labkit.cli import main
from labkit.errors import LabkitWarning
from labkit.files.provenance import check
from labkit.paths.rates import on_grains
from labkit.records.limits import relative_width, width_warning
from tests.conftest import PATIENCE
from tests.stopped import run_stopped

pytestmark = pytest.mark.slow

PATH = lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.004, rate=40.0)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder, with a separate folder for temporary files, which must be empty at the end."""
    for name in ("work", "temporary"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    yield tmp_path / "work"
    assert [name for name in (tmp_path / "temporary").iterdir() if name.name.startswith("labkit")] == []


@pytest.fixture(scope="module")
def state(loose_specimen):
    return loose_specimen


# --- a complete program, on both engines ---------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_a_complete_program(engine, folder):
    scene = lk.Scene(friction=0.5, rolling_friction=0.0)
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=300), scene, engine=engine, progress=False)
    run = lk.run(
        state, lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.01), engine=engine, snapshots=2, progress=False
    )
    assert run.complete is True and run.exceeded == () and run.file is None
    assert isinstance(run.data, xarray.Dataset) and run.engine == state.engine == engine
    assert run.scene == scene == state.scene and run.path == on_grains(
        lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.01), scene
    )
    assert run.steps == run.data.attrs["steps"] > 1000 and run.wall_time > 0.0 and run.threads == 1
    assert abs(state.number_of_grains / 300 - 1) < 0.03

    snapshot = run.snapshots[-1]
    assert len(run.snapshots) == 3 and snapshot.number == 2 and len(run.snapshots[1:]) == 2
    assert isinstance(snapshot, lk.Snapshot) and snapshot.scene == scene
    found, stored = lk.statistics(snapshot), run.data.isel(time=-1)
    for name, value in vars(found).items():
        np.testing.assert_allclose(value, stored[name], rtol=1e-12, atol=1e-15, err_msg=name)
    np.testing.assert_allclose(lk.love_stress(snapshot), stored["stress"], rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(lk.sff_stress(snapshot), stored["stress_sff"], rtol=1e-12, atol=1e-6)
    assert abs(lk.mean_stress(lk.love_stress(snapshot)) / 0.3e6 - 1.0) < 0.01
    assert lk.deviatoric_stress(lk.love_stress(snapshot)) / 0.3e6 > 0.3
    assert not snapshot.contacts.rolling_moment.any() and not state.rolling_moment.any()
    assert snapshot.contacts.tangential_force.any()

    failed = [finding.name for finding in lk.verify(run) if finding.decides and not finding.holds]
    equation = "equation by volume: largest error, norm"  # there are too few grains for it
    assert [name for name in failed if not name.startswith(equation)] == []
    assert isinstance(run.plot(), Figure) and isinstance(run.plot("shares"), Figure)
    assert len(lk.critical_states({"one": run.data})) == 1
    assert f"on {engine}, complete" in repr(run) and "in memory" in repr(run)
    assert list(folder.iterdir()) == []


@pytest.mark.yade
def test_both_engines_give_the_same_run(state):
    runs = {engine: lk.run(state, PATH, engine=engine, progress=False, snapshots=0) for engine in ("fused", "yade")}
    fused, yade = (runs[name].data for name in ("fused", "yade"))
    np.testing.assert_allclose(fused["axial_strain"], yade["axial_strain"], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(fused["void_ratio"], yade["void_ratio"], rtol=1e-4)
    np.testing.assert_allclose(fused.lab.mean_stress(), yade.lab.mean_stress(), rtol=5e-3)
    np.testing.assert_allclose(fused["stress"][0], yade["stress"][0], rtol=1e-2, atol=1e3)


# --- files ------------------------------------------------------------------------------------------------------


STORED = ("zlib", "shuffle", "complevel", "fletcher32", "chunksizes")


@pytest.mark.parametrize(("kind", "snapshots"), [("spheres", 0), ("spheres", 2), ("clumps", 2), ("links", 2)])
def test_a_file_holds_what_the_run_in_memory_holds(kind, snapshots, state, folder):
    path = PATH
    if kind == "clumps":
        state = lk.make_specimen(lk.Recipe(0.55, 0.15, 0.0, grains=120, shape="rod aspect_ratio=1.5"), progress=False)
        path = lk.paths.ConstantVolume(strain=0.004, rate=40.0)
    if kind == "links":
        state, path = state.replace(scene=lk.Scene(law="jkr")), lk.paths.ConstantVolume(strain=0.004, rate=40.0)
    options = {"snapshots": snapshots, "guarded": kind != "links", "progress": False}  # adhesion appears at once
    memory, run = lk.run(state, path, **options), lk.run(state, path, file="r.run.nc", **options)
    assert [name.name for name in folder.iterdir()] == ["r.run.nc"] and str(run.file) == "r.run.nc" and run.complete
    xarray.testing.assert_identical(memory.data.drop_attrs(), lk.open_run("r.run.nc").load().drop_attrs())
    for name, value in run.data.attrs.items():
        assert name in ("provenance", "wall_time") or np.array_equal(memory.data.attrs[name], value), name
    assert sorted(memory.data.attrs) == sorted(run.data.attrs) and list(memory.data.variables) == list(
        run.data.variables
    )
    for name, variable in run.data.variables.items():
        here = memory.data[name]
        assert here.attrs == variable.attrs and here.dtype == variable.dtype, name
        assert [here.encoding.get(key) for key in STORED] == [variable.encoding.get(key) for key in STORED], name
    assert memory.state.digest() == run.state.digest()
    for name in ("time", "step", "seed", "engine", "history", "recipe", "ledger"):
        assert getattr(memory.state, name) == getattr(run.state, name), name
    assert ("joined" in run.data) == (kind == "links")


def test_the_file_of_a_run(state, folder):
    run = lk.run(state, PATH, file="r.run.nc", snapshots=2, progress=False)
    assert run.provenance["labkit_version"] == lk.__version__ and run.provenance["inputs"] == []
    assert [verdict for _, verdict in check("r.run.nc")] == ["same"]
    assert "r.run.nc" in repr(run) and lk.Run.open("r.run.nc").path == PATH


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_an_interrupted_run_is_resumed_by_the_same_call(engine, state, folder):
    """An exception in the progress function stops the run; YADE's process then writes its checkpoint and ends."""
    arguments = {"engine": engine, "save_every": 1, "snapshots": 2}
    run_stopped(0.5, state, PATH, file="r.run.nc", **arguments)
    partial = lk.Run.open("r.run.nc")
    assert not partial.complete and 1 <= partial.data.sizes["time"] < 6 and "not complete" in repr(partial)
    partial.data.close()
    seen = []
    run = lk.run(state, PATH, file="r.run.nc", progress=lambda fraction, text: seen.append(fraction), **arguments)
    whole = lk.run(state, PATH, progress=False, **arguments)
    assert run.complete and seen[-1] == 1.0 and [name.name for name in folder.iterdir()] == ["r.run.nc"]
    np.testing.assert_array_equal(run.data["axial_strain"], whole.data["axial_strain"])
    if engine == "fused":  # it stopped at a planned save, so it is the same to the last bit
        np.testing.assert_array_equal(run.data["stress"], whole.data["stress"])
    else:
        np.testing.assert_allclose(run.data["stress"], whole.data["stress"], rtol=1e-2, atol=1e3)


def test_a_finished_run_is_not_run_again(state):
    first = lk.run(state, PATH, file="r.run.nc", snapshots=0, progress=False)
    seen, before = [], first.file.read_bytes()
    again = lk.run(state, PATH, file="r.run.nc", snapshots=0, progress=lambda *step: seen.append(step))
    assert again.complete and seen == [] and first.file.read_bytes() == before
    longer = lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.005, rate=40.0)
    with pytest.raises(lk.InputError, match=r"r\.run\.nc .*strain .*0\.004 .*0\.005"):
        lk.run(state, longer, file="r.run.nc", snapshots=0, progress=False)
    with pytest.raises(lk.InputError, match=r"r\.run\.nc .*specimen"):
        lk.run(state.replace(position=state.position + 1e-6), PATH, file="r.run.nc", snapshots=0, progress=False)
    assert first.file.read_bytes() == before


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_specimens_and_consolidation_with_and_without_a_file(engine, state, folder):
    reached = lk.consolidate(state, "200 kPa", engine=engine, file="c.state.nc", progress=False)
    np.testing.assert_allclose(np.diag(lk.love_stress(reached.snapshot())), 2e5, rtol=2e-3)
    assert [name.name for name in folder.iterdir()] == ["c.state.nc"]
    there = lk.read_state("c.state.nc")
    assert there.digest() == reached.digest() and there.recipe == state.recipe and there.engine == engine
    assert lk.open_state("c.state.nc").sizes["grain"] == state.number_of_grains
    made = lk.make_specimen(lk.Recipe(0.7, grains=120), engine=engine, file="s.state.nc", progress=False)
    assert lk.read_state("s.state.nc").digest() == made.digest()
    lk.write_state("copy.state.nc", made)
    assert sorted(name.name for name in folder.iterdir()) == ["c.state.nc", "copy.state.nc", "s.state.nc"]


def test_a_path_without_a_pressure_holds_the_pressure_of_the_specimen(state):
    run = lk.run(state, lk.paths.ConstantRadialStress(strain=0.002, rate=40.0), snapshots=0, progress=False)
    pressure = float(lk.mean_stress(lk.love_stress(state.snapshot())))
    assert run.path.pressure == pressure
    assert abs(run.data["stress"][-1, 0, 0] / pressure - 1.0) < 0.02


# --- progress ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_progress_is_printed_passed_to_a_function_or_silent(engine, state, capfd):
    lk.make_specimen(lk.Recipe(0.7, grains=120), engine=engine, progress=False)
    if engine == "fused":  # in YADE each call starts a new process
        lk.consolidate(state, 0.4e6, engine=engine, progress=False)
        lk.run(state, PATH, engine=engine, snapshots=0, progress=False)
    assert capfd.readouterr() == ("", "")
    lk.run(state, PATH, engine=engine, snapshots=0)
    out, err = capfd.readouterr()
    assert out.startswith("cp:   0%") and "cp: 100%" in out and err == ""
    seen = []
    lk.run(state, PATH, engine=engine, snapshots=0, progress=lambda fraction, text: seen.append((fraction, text)))
    assert capfd.readouterr() == ("", "")
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0 and all("strain" in text for _, text in seen[-3:])


# --- invalid input ------------------------------------------------------------------------------------------------


def test_bad_input_is_an_error_with_values_and_leaves_nothing(state, folder):
    (folder / "text.nc").write_text("not a netCDF file")
    lk.write_state("s.state.nc", state)
    before = {name: name.read_bytes() for name in folder.iterdir()}
    cp, cv = lk.paths.ConstantMeanStress, lk.paths.ConstantVolume
    for call, field, message in (
        (lambda: lk.make_specimen(lk.Recipe(0.67, side=2e-4), file="new.nc"), "side", "1.79"),
        (lambda: lk.make_specimen(lk.Recipe(0.67), file="new.nc", engine="warp"), "engine", "'warp'"),
        (
            lambda: lk.make_specimen(lk.Recipe(0.67), lk.Scene(law="spring_dashpot"), engine="yade"),
            "engine",
            "yade .* spring_dashpot.* fused",
        ),
        (lambda: lk.make_specimen(lk.Recipe(0.67), file="no/such/new.nc"), None, "no/such is not a directory"),
        (lambda: lk.make_specimen(lk.Recipe(0.67), file="text.nc"), None, "text.nc is not a labkit file"),
        (lambda: lk.consolidate(state, None, file="new.nc"), "pressure", "is missing"),
        (lambda: lk.consolidate(state, "4 MPa", file="new.nc"), "pressure", "3e.06 Pa"),
        (lambda: lk.run(state, cp(pressure=4e6), file="new.nc"), "pressure", "3e.06 Pa"),
        (lambda: lk.run(state, cv(rate=1e4, strain=1e-3), file="new.nc"), "rate", "rate 10000 "),
        (lambda: lk.run(state, cv(), file="s.state.nc"), None, "s.state.nc is a labkit state file"),
        (lambda: lk.run(state, cv(), file="new.nc", engine=lk.Fused(10_000)), "threads", "threads 10000 "),
        (lambda: lk.statistics(state), None, "a State is not a Snapshot: give one, such as run.snapshots"),
        (lambda: lk.Run.open("nowhere.run.nc"), None, "nowhere.run.nc does not exist"),
        (lambda: lk.run(state, PATH, progress=False).plot("roses"), "figure", "figure 'roses'"),
    ):
        with pytest.raises(lk.InputError, match=message) as refused:
            call()
        assert refused.value.field == field
        assert {name: name.read_bytes() for name in folder.iterdir()} == before


def test_a_physical_failure_is_an_error(state, folder):
    with pytest.raises(lk.PhysicsError, match="step1_friction"):
        lk.make_specimen(lk.Recipe(1.2, step1_friction=0.01, grains=150), file="s.state.nc", progress=False)
    unstable = state.replace(scene=lk.Scene(time_step_factor=0.5))
    with pytest.raises(lk.PhysicsError, match="time_step_factor"):
        lk.run(unstable, PATH, file="r.run.nc", progress=False)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("kept", [True, False], ids=["with a file", "in memory"])
@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_a_signal_ends_a_run_with_the_exit_code_of_a_shell(engine, kept, state, folder):
    lk.write_state("s.state.nc", state)
    code = f"""
import os, signal
import labkit as lk
from labkit.cli import main
from labkit.errors import LabkitWarning
path = lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.05, rate=40.0)
stop = lambda fraction, text: os.kill(os.getpid(), signal.SIGTERM) if 0.1 < fraction < 0.9 else None
try:
    lk.run(lk.read_state("s.state.nc"), path, engine="{engine}", file={"r.run.nc" if kept else None!r}, save_every=1,
           progress=stop)
except lk.Interrupted as error:
    print(error)
    raise SystemExit(error.code)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 143, done.stderr
    if kept:
        assert "r.run.nc" in done.stdout
        with netCDF4.Dataset("r.run.nc") as run:
            assert run.complete == 0 and len(run["time"]) >= 2
    else:
        assert done.stdout == "stopped by a signal; nothing was saved, because the run has no file\n"
        assert [name.name for name in folder.iterdir()] == ["s.state.nc"]


def test_a_signal_during_the_consolidation_ends_a_run_in_memory(state, folder):
    def stop(fraction, text):
        if text.startswith("consolidation"):
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(lk.Interrupted) as stopped:
        lk.run(state, PATH, progress=stop)
    assert stopped.value.code == 143 and list(folder.iterdir()) == []


def test_a_run_in_a_thread_is_the_run_in_the_main_thread(state):
    """This is the case in the executor of a notebook; only the main thread can handle signals."""
    found = []
    worker = threading.Thread(target=lambda: found.append(lk.run(state, PATH, snapshots=0, progress=False)))
    worker.start()
    worker.join()
    here = lk.run(state, PATH, snapshots=0, progress=False)
    np.testing.assert_array_equal(found[0].data["stress"], here.data["stress"])


def test_all_public_names_exist():
    assert set(lk.__all__) <= set(dir(lk)) and "run" in lk.__all__ and "Run" in lk.__all__
    for name in lk.__all__:
        assert getattr(lk, name) is not None
    with pytest.raises(AttributeError, match="'rum'"):
        _ = lk.rum


def test_a_cell_of_a_few_grains_gives_a_warning_with_the_number_needed():
    with pytest.warns(UserWarning, match=r"only 3\.8 of its largest grains .* give about 1,900 grains") as warned:
        state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=100), progress=False)
    assert {warning.filename for warning in warned if warning.category is LabkitWarning} == {__file__}
    wide = state.replace(cell=10.01 / relative_width(state.cell, state.radius) * state.cell)
    assert width_warning(wide) is None


@pytest.mark.filterwarnings("ignore:a mean stress of")  # in addition to the overlap
def test_a_specimen_that_exceeds_a_limit_is_made_with_the_same_warnings_by_the_command(capsys):
    said = r"a mean overlap of \d\.\d+ % is above the limit of 2 % in the specimen: give a larger void ratio"
    with pytest.warns(UserWarning, match=said) as warned:
        lk.make_specimen(lk.Recipe(void_ratio=0.3, grains=200), progress=False)
    assert {warning.filename for warning in warned if warning.category is LabkitWarning} == {__file__}
    assert main(["specimen", "--void-ratio", "0.3", "--grains", "200", "-o", "s.state.nc"]) == 0
    printed = "".join(capsys.readouterr())
    messages = [str(warning.message) for warning in warned if warning.category is LabkitWarning]
    assert len(messages) > 1 and all(message in printed for message in messages)


def test_a_misspelled_argument_is_a_type_error(state):
    cv = lk.paths.ConstantVolume()
    for call in (
        lambda: lk.run(state, cv, engin="yade"),
        lambda: lk.run_many([(state, cv)], engin="yade"),
        lambda: lk.make_specimen(lk.Recipe(0.67), presision="mixed"),
        lambda: lk.consolidate(state, 1e5, sell="free"),
        lambda: lk.probe(state, planes="all"),
        lambda: lk.Scene(fricton=0.5),
        lambda: lk.Recipe(0.67, grain=500),
        lambda: lk.paths.ConstantMeanStress(presure=3e5),
        lambda: lk.run(state, cv, "yade"),
        lambda: lk.make_specimen(lk.Recipe(0.67), lk.Scene(), "yade"),
    ):
        with pytest.raises(TypeError, match="argument"):
            call()


def test_functions_of_the_front_door_have_one_order_of_arguments():
    """Two arguments by position, then engine, file and progress by name; progress is shown by default."""
    for function in (
        lk.make_specimen,
        lk.consolidate,
        lk.run,
        lk.run_many,
        lk.probe,
        lk.density_limits,
        lk.specimen_at,
        lk.calibrate_grains,
    ):
        known = inspect.signature(function).parameters
        by_position = [name for name, one in known.items() if one.kind is one.POSITIONAL_OR_KEYWORD]
        common = [name for name in known if name in ("engine", "file", "progress")]
        assert len(by_position) <= 2 and known["progress"].default is True, function.__name__
        assert common == sorted(common) and all(known[name].kind is known[name].KEYWORD_ONLY for name in common)
