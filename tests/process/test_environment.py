"""Closed and full outputs, signals, broken environment variables, a yade that does nothing, little memory."""

import os
import shlex
import shutil
import signal
import subprocess
import sys

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.files.atomic import write_text
from labkit.grains.state_file import read_state, write_state
from tests.killed import signalled

pytestmark = pytest.mark.slow

LABKIT = [sys.executable, "-m", "labkit.cli"]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A specimen of 120 grains."""
    file = tmp_path_factory.mktemp("small") / "s.state.nc"
    write_state(file, lk.make_specimen(lk.Recipe(void_ratio=0.66, grains=120), lk.Scene(), progress=False))
    return file


def shell(redirection, *words, **environment):
    """`labkit words` with its output redirected by the shell."""
    command = f"{shlex.join([*LABKIT, *map(str, words)])} {redirection}"
    environment = {**os.environ, **environment}
    return subprocess.run(["bash", "-c", command], env=environment, capture_output=True, text=True)


OUTPUTS = [">/dev/full", "| head -1", ">&-", "2>/dev/full", "2>&1 | head -1", "2>&1 >/dev/full | head -c 9", "2>&-"]


@pytest.mark.parametrize("redirection", OUTPUTS)
def test_a_run_is_completed_whatever_happens_to_its_output(redirection, small, tmp_path):
    file = tmp_path / "r.run.nc"
    words = ["run", "cv", small, "--strain", "0.002", "--engine", "fused", "-o", file]
    done = shell(redirection, *words)
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr, done.stderr
    with netCDF4.Dataset(file) as run:
        assert run.complete == 1
    assert done.returncode == 0


def test_a_result_that_cannot_be_printed_is_an_error(small):
    done = shell(">/dev/full", "info", small)
    assert done.returncode == 1 and done.stderr == "labkit: standard output: No space left on device\n"


def test_an_error_that_cannot_be_printed_keeps_its_exit_code(tmp_path):
    assert shell("2>/dev/full", "info", tmp_path / "none.state.nc").returncode == 2


@pytest.mark.parametrize("settings", [{"LC_ALL": "C"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}])
def test_names_that_the_locale_cannot_show_are_escaped(settings, small, tmp_path):
    file = tmp_path / "körner.state.nc"
    file.write_bytes(small.read_bytes())
    done = shell("", "info", file, **settings)
    if len(settings) == 1:
        assert done.returncode == 0 and "labkit state file" in done.stdout, done.stderr
    else:
        assert done.returncode == 2 and "is not ascii text: rename the file" in done.stderr, done.stderr


def test_a_name_that_is_not_utf_8_is_refused(small, tmp_path, capsys):
    file = tmp_path / "k\udcff.state.nc"
    file.write_bytes(small.read_bytes())
    assert main(["info", str(file)]) == 2
    assert capsys.readouterr().err.endswith("k\\udcff.state.nc is not utf-8 text: rename the file\n")


@pytest.mark.parametrize(
    "name, value", [("NUMBA_NUM_THREADS", "-1"), ("NUMBA_NUM_THREADS", "0"), ("NUMBA_THREADING_LAYER", "nonsense")]
)
def test_environment_variables_that_stop_numba_are_named(name, value, small, monkeypatch, capsys):
    monkeypatch.setenv(name, value)
    assert main(["info", str(small)]) == 2
    assert capsys.readouterr().err.startswith(f"labkit: the environment variable {name} is '{value}': give ")


@pytest.mark.parametrize(
    "name, value",
    [
        *(("NUMBA_DISABLE_JIT", value) for value in ("1", "true")),
        *((f"NUMBA_{name}", "zz") for name in ("OPT", "ENABLE_AVX", "FULL_TRACEBACKS", "LOOP_VECTORIZE")),
    ],
)
def test_environment_variables_with_which_nothing_can_be_compiled_are_named(name, value, small, tmp_path):
    output, cache = tmp_path / "r.run.nc", {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    done = shell("", "run", "cv", small, "--strain", "0.002", "-o", output, **{name: value}, **cache)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and not output.exists(), done.stderr
    assert (
        name in done.stderr and f"'{value}'" in done.stderr.replace(" is 1 ", " is '1' ") and "unset it" in done.stderr
    )


def test_code_is_compiled_for_a_processor_that_llvm_knows(small, tmp_path):
    settings = {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    done = shell("", "run", "cv", small, "--strain", "0.002", "-o", tmp_path / "r.run.nc", **settings)
    assert done.returncode == 0, done.stderr


LOOPS = {
    "use": ["run", "cv", "s.state.nc", "--use", "loop.py", "-o", "r.run.nc"],
    "output": ["run", "cv", "s.state.nc", "--strain", "1e-3", "-o", "loop.run.nc"],
    "folder of the output": ["run", "cv", "s.state.nc", "--strain", "1e-3", "-o", "loop/r.run.nc"],
    "specimen": ["run", "cv", "loop.state.nc", "-o", "r.run.nc"],
    "consolidated state": ["consolidate", "s.state.nc", "--pressure", "2MPa", "-o", "loop.state.nc"],
    "file to read": ["info", "loop.run.nc"],
    "picture": ["picture", "s.state.nc", "-o", "loop.png"],
    "campaign": ["campaign", "loop.yaml"],
    "file of grains": ["import", "loop.txt", "-o", "x.state.nc"],
    "table": ["model", "cv", "-o", "m.run.nc", "--figure", "loop.png", "--csv", "loop.csv"],
}


@pytest.mark.parametrize("what", LOOPS)
def test_a_link_that_leads_to_itself_is_one_sentence(what, small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.state.nc").write_bytes(small.read_bytes())
    for name in ("loop", *(f"loop.{end}" for end in ("py", "run.nc", "state.nc", "png", "yaml", "txt", "csv"))):
        (tmp_path / name).symlink_to(name)
    assert main(LOOPS[what]) == 2
    said = capsys.readouterr().err
    assert said.startswith("labkit: ") and said.count("\n") == 1


def test_a_backend_of_matplotlib_that_does_not_exist_is_not_used(small, tmp_path):
    done = shell("", "picture", small, "-o", tmp_path / "p.png", MPLBACKEND="nonsense")
    assert done.returncode == 0, done.stderr


def test_a_yade_that_does_nothing_is_not_believed(small, tmp_path):
    """Runs in a separate process, because this one may have an idle YADE."""
    program = tmp_path / "bin" / "yade"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\nexit 0\n")
    program.chmod(0o755)
    output = tmp_path / "r.run.nc"
    path = f"{program.parent}:{os.environ['PATH']}"
    done = shell("", "run", "cv", small, "--engine", "yade", "-o", output, PATH=path)
    assert done.returncode == 1 and not output.exists()
    assert "(start)" in done.stderr, done.stderr


def test_little_memory_ends_in_one_line(small):
    done = subprocess.run(
        ["bash", "-c", f"ulimit -v 900000; exec {shlex.join([*LABKIT, 'info', str(small)])}"],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert "Traceback" not in done.stderr, done.stderr


def test_an_interrupted_consolidation_is_continued(small, tmp_path):
    output = tmp_path / "c.state.nc"
    kept = tmp_path / ".c.state.nc.consolidation"
    words = ["consolidate", small, "--pressure", "2MPa", "-o", output]
    done = signalled(signal.SIGHUP, "report", 3, *words)
    assert done.returncode == 128 + signal.SIGHUP and f"{kept} keeps the consolidation so far" in done.stderr
    reached = read_state(kept).step
    assert reached > 0 and not output.exists()
    assert main(list(map(str, words))) == 0 and not kept.exists()
    state = read_state(output)
    np.testing.assert_allclose(np.diag(lk.love_stress(state.snapshot())), 2e6, rtol=2e-3)
    assert state.history.count("\n") <= 1 and "consolidate" in state.history


@pytest.mark.parametrize(
    "words",
    [
        ["consolidate", "{}", "--pressure", "1MPa", "-o", "{}"],
        ["bond", "{}", "-o", "{}"],
        ["statistics", "{}", "--csv", "{}"],
        ["statistics", "{}", "--json", "{}"],
    ],
    ids=lambda words: words[0] + words[-2],
)
def test_no_command_replaces_its_own_input(small, tmp_path, words, capsys):
    file = tmp_path / "s.state.nc"
    shutil.copy(small, file)
    assert main([word.format(file) for word in words]) == 2
    assert "is also an input" in capsys.readouterr().err and file.read_bytes() == small.read_bytes()


def test_two_outputs_of_a_command_are_two_files(small, tmp_path, capsys):
    file = str(tmp_path / "s.txt")
    assert main(["statistics", str(small), "--csv", file, "--json", file]) == 2
    assert "two outputs have the same name" in capsys.readouterr().err and not os.path.exists(file)


def test_a_specimen_stopped_by_a_signal_leaves_nothing_behind(tmp_path):
    words = ["specimen", "--void-ratio", 0.62, "--grains", 300, "-o", tmp_path / "s.state.nc"]
    done = signalled(signal.SIGTERM, "report", 2, *words)
    assert done.returncode == 143 and done.stderr.endswith("labkit: stopped by signal 15; no unfinished file is left\n")
    assert list(tmp_path.iterdir()) == []


def test_a_read_only_file_is_not_replaced(small, tmp_path, capsys):
    file = tmp_path / "s.state.nc"
    file.write_bytes(small.read_bytes())
    file.chmod(0o444)
    words = ["specimen", "--void-ratio", "0.65", "--grains", "120", "--engine", "fused", "-o", str(file)]
    assert main(words) == 2 and capsys.readouterr().err == (
        f"labkit: {file} is read-only: change its permissions, or choose another name\n"
    )
    assert file.read_bytes() == small.read_bytes()


def test_what_a_killed_process_left_is_removed(tmp_path):
    ended = subprocess.Popen(["true"])
    ended.wait()
    names = (ended.pid, os.getppid(), f"probe.{ended.pid}")  # the last one checks that the folder is writable
    left, used, probe = (tmp_path / f".a.txt.{name}.tmp" for name in names)
    for file in (left, used, probe):
        file.write_text("half")
    write_text(tmp_path / "a.txt", "whole")
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "a.txt", used])
