"""Things that stop or mislead a command: names in files, empty options, truncated caches and imports, two writers."""

import contextlib
import ctypes
import fcntl
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.engines.kernel import machine
from labkit.engines.kernel.translate import load_numba
from labkit.errors import Interrupted
from labkit.process.interruption import delay_interrupts, end_on_signals, only_writer, stop_on_signals
from labkit.records.limits import size_warning
from tests.changed import changed
from tests.conftest import ROOT


@pytest.mark.parametrize("name", ["../new.txt", "/tmp/new.txt", "folder/new.txt"])
def test_a_driver_file_cannot_write_to_another_folder(name, tmp_path, capsys):
    test = tmp_path / "test.inp"
    test.write_text(f"{name}\n*TriaxialE1\n100 10 10\n-0.1\n")
    words = ["driver", str(test), "--on", "model", "--initial", str(tmp_path / "initialconditions.inp")]
    assert main(words) == 2
    assert f"names its output in another folder, {name}: say where with --columns" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [test]


@pytest.mark.parametrize("words", [["-o", ""], ["--output=--"], ["--output="], ["--csv=--"]])
def test_an_empty_option_is_refused(words, capsys):
    assert main(["figure", "test", "r.run.nc", *words]) == 2
    assert " is empty: give a value" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, said",
    [
        (["--pressure", "300", "kpa", "s.state.nc"], "kpa stands alone: write the value and its unit without a space"),
        (["s.state.nc", "--pressure", "0.3", "MN/m^2"], "as in 0.3MN/m2"),
        (["s.state.nc", "--pressure", "-inf"], "--pressure -inf is not valid"),
    ],
)
def test_a_unit_apart_and_an_infinite_pressure_are_refused_for_their_reason(words, said, capsys):
    assert main(["consolidate", *words]) == 2
    assert said in capsys.readouterr().err


def test_an_array_of_text_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([["1", "1", "1", "0.1"]]))
    with pytest.raises(lk.InputError, match="not numbers: give an array of numbers"):
        lk.import_state(tmp_path / "a.npy", box="4", length_unit="mm", size="radius")


@pytest.mark.slow
def test_a_command_says_that_it_replaces_a_state(tmp_path, capsys):
    (tmp_path / "a.txt").write_text("1 1 1 0.5\n2 1 1 0.5\n1 2 1 0.5\n")
    known = ["--box", "4", "--length-unit", "mm", "--size", "radius", "-o", str(tmp_path / "a.state.nc")]
    said = [main(["import", str(tmp_path / "a.txt"), *known]) or capsys.readouterr().out for _ in range(2)]
    first = f"{tmp_path}/a.state.nc already exists and will be replaced\n"
    assert not said[0].startswith(first) and said[1].startswith(first)


def test_two_processes_cannot_make_the_same_state(soft_specimen, tmp_path):
    """The later one would win, and both would report success."""
    file = tmp_path / "o.state.nc"
    with only_writer(file), pytest.raises(lk.InputError, match="is being written by another process"):
        lk.consolidate(soft_specimen, 2e5, file=file, progress=False)
    lk.consolidate(soft_specimen, 1e5, file=file, progress=False)
    assert list(tmp_path.iterdir()) == [file]


def test_two_processes_cannot_import_to_the_same_file(tmp_path, capsys):
    (tmp_path / "a.txt").write_text("1 1 1 0.5\n2 1 1 0.5\n1 2 1 0.5\n")
    file, known = tmp_path / "a.state.nc", ["--box", "4", "--length-unit", "mm", "--size", "radius"]
    words = ["import", str(tmp_path / "a.txt"), *known, "-o", str(file)]
    with only_writer(file):
        assert main(words) == 2
    assert f"labkit: {file} " in capsys.readouterr().err and not file.exists()
    assert main(words) == 0


@pytest.fixture
def written(tmp_path, monkeypatch):
    """A function that compiles in this test's folder and notes the process that compiles each function in a file."""
    monkeypatch.setattr(machine, "compiled_folder", lambda: tmp_path / "compiled")
    (tmp_path / "compiled").mkdir()
    load_numba()

    def value(stamp="2.0"):
        def write():
            with open(tmp_path / "written", "a") as file:
                file.write(f"{stamp}\n")
            factor, float64 = float(stamp), load_numba().float64
            return lambda x: factor * x, float64(float64)

        place = machine.address_of("times", write, stamp)
        return ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(place)(2.0)

    return value, tmp_path


def test_a_cache_that_is_cut_off_is_made_again(written):
    value, folder = written
    assert value() == value() == 4.0 and (folder / "written").read_text() == "2.0\n"
    (file,) = (folder / "compiled").iterdir()
    whole = file.read_bytes()
    for number, left in enumerate((whole[:-1], whole[:20], b""), 2):
        file.write_bytes(left)
        assert value() == value() == 4.0 and (folder / "written").read_text() == number * "2.0\n"


@pytest.mark.slow
def test_processes_that_compile_at_the_same_time_keep_the_work_of_others(written):
    """Each function is compiled by one of them."""
    value, folder = written
    stamps = [f"{number}.0" for number in range(1, 9)]

    def all_values(first):
        order = stamps[first:] + stamps[:first]
        os._exit(0 if [value(stamp) for stamp in order] == [2.0 * float(stamp) for stamp in order] else 1)

    fork = multiprocessing.get_context("fork")
    processes = [fork.Process(target=all_values, args=(first,)) for first in (0, 0, 3, 6)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 0, 0, 0]
    assert sorted((folder / "written").read_text().split()) == stamps
    assert [file.suffix for file in (folder / "compiled").iterdir()] == 8 * [".o"]


def test_a_process_that_stopped_while_it_compiled_delays_others_but_does_not_block_them(written, monkeypatch, capsys):
    value, folder = written
    monkeypatch.setattr(machine, "PATIENCE", 0.2)
    with open(machine.code_file("times", "2.0").with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of the process that stopped
        assert value() == 4.0 and "compiling it here too" in capsys.readouterr().err
        assert value() == 4.0 and (folder / "written").read_text() == "2.0\n"
    assert [file.suffix for file in (folder / "compiled").iterdir()] == [".o"]


def test_a_signal_ends_the_wait_for_a_process_that_stopped(written, capsys):
    value, _ = written
    lock = open(machine.code_file("times", "2.0").with_suffix(".lock"), "w")
    with lock, pytest.raises(KeyboardInterrupt), stop_on_signals():
        fcntl.flock(lock, fcntl.LOCK_EX)
        signal.raise_signal(signal.SIGINT)
        assert value() == 4.0 and capsys.readouterr().err == ""


@pytest.mark.parametrize("number, error", [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Interrupted)])
def test_a_signal_that_no_run_answers_is_delivered_at_its_end(number, error):
    """In a loop of short runs, every Ctrl-C after the last record of a run was lost."""
    done = []
    with pytest.raises(error), end_on_signals():
        for _ in range(2):
            with stop_on_signals():
                signal.raise_signal(number)
            done.append(True)
    assert not done


def test_ctrl_c_waits_for_the_end_of_an_import():
    done = []
    with pytest.raises(KeyboardInterrupt), delay_interrupts():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        done.append(True)
    assert done == [True]


class SignalledAtItsEnd:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)


def test_a_signal_sent_twice_does_not_interrupt_the_end():
    """As `timeout` does; the first one asks a campaign to write its checkpoints."""
    ended = []
    with end_on_signals():
        try:
            signal.raise_signal(signal.SIGTERM)
        except Interrupted:
            signal.raise_signal(signal.SIGTERM)
            ended.append(True)
    assert ended


def test_a_library_that_catches_every_exception_does_not_swallow_a_signal():
    """As some do while they are imported; the command then went on."""
    with pytest.raises(Interrupted, match="15"), end_on_signals(), contextlib.suppress(Exception):
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_within_the_end_of_an_object_ends_the_command(capfd):
    """Python ignores exceptions raised there, and the command went on after a traceback on standard error."""
    with pytest.raises(Interrupted, match="15"), end_on_signals():
        SignalledAtItsEnd()
        time.sleep(60.0)
    assert "Traceback" not in capfd.readouterr().err


TWICE = """
import os, signal, sys, threading
from labkit.cli import program
from labkit.cli.dispatch import report_errors
from labkit.process.interruption import delay_interrupts, nothing_saved, stop_on_signals

def press():
    os.kill(os.getpid(), signal.SIGINT)

def press_again():
    threading.main_thread().join()
    press()

def work():
    threading.Thread(target=press_again).start()
    if sys.argv[1] == "run":
        with stop_on_signals() as signals:
            press()
            raise nothing_saved(signals.caught)
    if sys.argv[1] == "import":
        with delay_interrupts():
            press()
    press()

sys.exit(program(lambda: report_errors(work)))
"""


@pytest.mark.slow
@pytest.mark.parametrize("when", ["run", "import", "other"])
def test_a_second_ctrl_c_while_python_ends_its_threads_prints_nothing(when):
    done = subprocess.run([sys.executable, "-c", TWICE, when], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 130 and done.stderr.count("\n") == 1, done.stderr


@pytest.mark.slow
def test_ctrl_c_while_numba_is_imported_leaves_it_whole(tmp_path):
    program = """
import os, signal, sys, threading, time
import numpy as np
import labkit as lk
from labkit.engines.fused import FusedEngine
from labkit.grains.state import grains_in_cell

def interrupt():
    while not any(name.startswith("numba.core") for name in tuple(sys.modules)):
        time.sleep(0.001)
    os.kill(os.getpid(), signal.SIGINT)

grains = grains_in_cell(lk.Scene(), np.full(2, 1e-4), np.array([[0, 0, 0], [0, 0, 1.9e-4]]), np.eye(3) * 1e-3)
threading.Thread(target=interrupt, daemon=True).start()
try:
    FusedEngine(grains)
except KeyboardInterrupt:
    print("interrupted")
print(FusedEngine(grains).state().number_of_grains)
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.stdout == "interrupted\n2\n", done.stderr


def test_a_checkpoint_of_the_wrong_shape_is_damage(soft_specimen, tmp_path):
    file = tmp_path / "r.run.nc"
    path = lk.paths.ConstantVolume(strain=0.001)
    lk.run(soft_specimen, path, file=file, progress=False)
    with changed(file) as dataset:
        dataset.complete = np.int32(0)
        dataset["checkpoint"].lattice = np.ones(4)
    with pytest.raises(lk.InputError, match="its checkpoint: "):
        lk.run(soft_specimen, path, file=file, progress=False)


def test_a_run_file_that_is_replaced_while_it_is_opened_is_one_save(soft_specimen, tmp_path, monkeypatch):
    """Its groups used to be opened one after the other by name, between which the file may be replaced."""
    from labkit.results import dataset

    file, other = tmp_path / "r.run.nc", tmp_path / "longer.run.nc"
    for name, strain in ((file, 0.001), (other, 0.002)):
        lk.run(soft_specimen, lk.paths.ConstantVolume(strain=strain), file=name, progress=False, snapshots=2)
    open_dataset = dataset.xr.open_dataset

    def opened(*given, **options):
        found = open_dataset(*given, **options)
        shutil.copyfile(other, tmp_path / "new")
        os.replace(tmp_path / "new", file)
        return found

    monkeypatch.setattr(dataset.xr, "open_dataset", opened)
    run = lk.Run.open(file)
    assert float(run.data["axial_strain"][-1]) == pytest.approx(0.001, rel=0.01)
    assert float(run.snapshots[-1].axial_strain) == pytest.approx(0.001, rel=0.01)


def test_a_tiny_diameter_is_questioned():
    assert "1e-09 m: soils have more" in str(size_warning(lk.Scene(mean_diameter=1e-9)))
    assert size_warning(lk.Scene()) is None


def test_a_run_says_that_its_grains_do_not_touch_any_more(soft_specimen):
    run = lk.run(soft_specimen, lk.paths.IsotropicDilation(pressure="1e-3 Pa"), progress=False)
    assert run.complete and run.met_conditions == ("no grains touch any more (p = 0, Z = 0)",)


def test_open_runs_close_their_file(soft_specimen, tmp_path):
    file = tmp_path / "r.run.nc"
    lk.run(soft_specimen, lk.paths.ConstantVolume(strain=0.001), file=file, progress=False)
    with contextlib.closing(lk.open_run(file)) as run:
        assert run.sizes["time"] > 1
    links = (Path("/proc/self/fd") / name for name in os.listdir("/proc/self/fd"))
    assert str(file) not in {os.readlink(link) for link in links if link.is_symlink()}
    with netCDF4.Dataset(file) as again:
        assert again.complete == 1
