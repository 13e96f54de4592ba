"""The C++ host: what reaches it is checked, and what it does is watched by sanitizers and a second compiler."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import labkit as lk
from labkit.engines.fused import FusedEngine
from labkit.engines.host import build
from labkit.engines.kernel import host
from labkit.engines.kernel.layout import ARRAYS
from labkit.engines.kernel.loop import Loop
from labkit.engines.kernel.packing import History
from labkit.grains.state import grains_in_cell
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

PROGRAM = """
import hashlib, sys
from pathlib import Path
import numpy as np
import labkit as lk
from labkit.engines.fused import FusedEngine
from labkit.engines.kernel import host
if len(sys.argv) > 1:
    host._file = lambda: Path(sys.argv[1])
found = []
for words in ({}, {"law": "bonded"}, {"law": "capillary"}, {"friction": 0.0, "law": "spring_dashpot"}):
    for precision in ("double", "mixed"):
        scene = lk.Scene(**words)
        random = np.random.default_rng(4)
        position = (np.indices((6, 6, 6)).reshape(3, -1).T + 0.1 * random.random((216, 3))) * 1.9e-4
        grains = lk.grains.state.grains_in_cell(scene, np.full(216, 1e-4), position, np.eye(3) * 6 * 1.9e-4)
        engine = FusedEngine(grains, precision=precision, skin=0.001)  # a search every few steps
        engine.advance(200, np.array([[0.0, 0.0, 80.0], [0.0, 0.0, 0.0], [0.0, 0.0, -80.0]]))
        state = engine.state()
        found += [state.position, state.velocity, state.tangential_force, engine.stress()]
print(hashlib.sha256(b"".join(array.tobytes() for array in found)).hexdigest())
"""


def outcome(*words, **environment):
    """What the program prints; without sanitizers reporting anything."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM, *map(str, words)],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and "runtime error" not in done.stderr, done.stderr[-3000:]
    return done.stdout


def library_of(name):
    """Path of a library of the compiler."""
    return subprocess.run(["g++", f"-print-file-name={name}"], capture_output=True, text=True).stdout.strip()


@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_sanitizers_find_nothing_and_the_bits_stay(tmp_path):
    known = outcome()
    watched = build.build_host(tmp_path, ["-fsanitize=address,undefined", "-fno-sanitize=vptr", "-O1", "-g"])
    preload = f"{library_of('libasan.so')} {library_of('libubsan.so')}"
    assert outcome(watched, LD_PRELOAD=preload, ASAN_OPTIONS="detect_leaks=0:verify_asan_link_order=0") == known


@pytest.mark.skipif(not shutil.which("clang++"), reason="needs clang++")
def test_another_compiler_gives_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setenv("CXX", "clang++")
    assert outcome(build.build_host(tmp_path)) == outcome()


def test_without_a_compiler_one_sentence_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(build.CannotCompile, match=r"apt-get install g\+\+.*pip install ziglang"):
        build.build_host(tmp_path)


def test_a_source_that_does_not_compile_is_reported_in_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(build, "LIBRARY", ["-DWIDTH=0)"])
    with pytest.raises(build.CannotCompile, match=r"^the kernel of labkit cannot be compiled with .*: .*error"):
        build.build_host(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_another_layout_is_refused(monkeypatch):
    monkeypatch.setattr(host, "LAYOUT", (*host.LAYOUT[:-1], host.LAYOUT[-1] + 1))
    with pytest.raises(lk.InputError, match=r"layout\.hpp and .*layout\.py differ"):
        host.library.__wrapped__()


@pytest.fixture(scope="module")
def engine():
    random = np.random.default_rng(4)
    position = (np.indices((20, 20, 20)).reshape(3, -1).T + 0.1 * random.random((8000, 3))) * 1.9e-4
    return FusedEngine(grains_in_cell(lk.Scene(), np.full(8000, 1e-4), position, np.eye(3) * 20 * 1.9e-4))


def loop_of(engine, **changes):
    """A loop for the arrays of an engine, some of them changed."""
    kept = engine._loop._kept
    return Loop(
        engine.packing.arrays._replace(**changes), *kept[1:3], engine._functions, engine._needs, engine._damping
    )


@pytest.mark.parametrize("name", ARRAYS.kind._fields)
def test_an_array_of_another_kind_length_or_order_never_reaches_the_host(name, engine):
    loop_of(engine)
    array = getattr(engine.packing.arrays, name)
    other = np.int32 if array.dtype != np.int32 else float
    wrong = [np.zeros_like(array, other), array[..., None], np.repeat(array, 2, axis=-1)[..., ::2]]
    for values in [*wrong, *([] if name == "blocks" else [array[:1]])]:
        with pytest.raises(ValueError, match=r"^(Arrays\.|the domains do not|a contact or an image)"):
            loop_of(engine, **{name: values})


@pytest.mark.parametrize("name", ["pairs", "owner", "contact_last", "image_first", "grain_first"])
def test_an_index_beyond_the_end_never_reaches_the_host(name, engine):
    array = getattr(engine.packing.arrays, name).copy()
    array.flat[-1] = 2_000_000
    with pytest.raises(ValueError, match=r"does not exist|do not divide"):
        loop_of(engine, **{name: array})


CHANGES = {
    "contact_grain": lambda a: a + 1_000_000,
    "contact_shift": lambda a: a + 10_000,
    "tangential_force": lambda a: a[:-1],
    "radius": lambda a: a[:-1],
    "position": lambda a: np.where(np.arange(len(a))[:, None] == 3, np.nan, a),
    "cell": lambda a: a * np.inf,
}


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("name", CHANGES)
def test_a_state_whose_arrays_do_not_fit_is_refused_in_one_sentence(name, engine):
    state = engine.state()
    assert len(state.contact_grain) > 1000
    with pytest.raises(lk.InputError, match=r"^the state is not one of grains in a cell: "):
        FusedEngine(state.replace(**{name: CHANGES[name](getattr(state, name))}))


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 5), st.integers(0, 5))
def test_a_history_whose_lengths_differ_never_reaches_the_host(pairs, shifts, rows, odd):
    history = History(
        np.zeros((2, pairs), np.int32),
        np.zeros((shifts, 3), np.int32),
        np.zeros((rows, 3)),
        np.ones(odd, bool),
        np.zeros(4, np.int64),
    )
    new = np.zeros((2, 1), np.int32), np.zeros((1, 3), np.int32), np.zeros(1, np.int64), np.ones(1)
    blocks = np.zeros((1, 4, 64))
    if pairs == shifts == rows and odd == 3:
        host.carry_history(history, *new, blocks)
    else:
        with pytest.raises(ValueError, match="an array has the shape"):
            host.carry_history(history, *new, blocks)


def run_program(program):
    return subprocess.run([sys.executable, "-P", "-c", program], cwd=ROOT, capture_output=True, text=True)


def test_a_law_without_a_file_is_compiled_once_per_process():
    """An engine loads a state at every checkpoint, and compiling takes seconds."""
    program = """
import labkit as lk
from labkit.engines.fused import needs_of
from labkit.engines.kernel.blocks import compile_functions

@lk.register_law
class Written(lk.ContactLaw):
    name = "written_in_a_cell"
    parts = lk.laws.LinearSpring()

law, scene = Written(), lk.Scene(law="written_in_a_cell")
first = compile_functions(law, needs_of(scene, "double"))
print(all(first[:2]), compile_functions(Written(), needs_of(scene, "double")) is first)
"""
    done = run_program(program)
    assert done.stdout == "True True\n", done.stderr


def test_a_process_forked_from_one_with_several_threads_goes_on(engine):
    """OpenMP's threads do not survive a fork, and it would wait for them for ever."""
    program = """
import multiprocessing, sys
import numpy as np
from labkit.engines.fused import FusedEngine
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell

random = np.random.default_rng(4)
position = (np.indices((20, 20, 20)).reshape(3, -1).T + 0.1 * random.random((8000, 3))) * 1.9e-4
engine = FusedEngine(grains_in_cell(Scene(), np.full(8000, 1e-4), position, np.eye(3) * 20 * 1.9e-4), 2)

def advance(engine):
    engine._choice.count = 2
    engine.advance(5, np.diag([0.0, 0.0, -1.0]))
    return engine.state().position.sum()

advance(engine)
fork = multiprocessing.get_context("fork").Process(target=advance, args=(engine,))
fork.start()
fork.join()
print(fork.exitcode, advance(engine) > 0.0)
"""
    done = run_program(program)
    assert done.stdout == "0 True\n" and "forked" in done.stderr, done.stderr
