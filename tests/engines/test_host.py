"""The C++ host: what reaches it is checked, and what it does is watched by sanitizers and a second compiler."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import labkit as lk
from labkit.engines import mpi
from labkit.engines.fused import FusedEngine
from labkit.engines.host import build
from labkit.engines.kernel import host
from labkit.engines.kernel.layout import ARRAYS, COMPILED
from labkit.engines.kernel.loop import Loop
from labkit.engines.kernel.neighbours import sort_grains
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
    host.library_file = lambda: Path(sys.argv[1])
found = []
LAWS = ({}, {"law": "bonded"}, {"law": "capillary"}, {"friction": 0.0, "law": "spring_dashpot"})
for words in LAWS:
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


def outcome(*words, cwd=ROOT, program=PROGRAM, **environment):
    """What the program prints; without sanitizers reporting anything."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", program, *map(str, words)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(cwd), **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and "runtime error" not in done.stderr, done.stderr[-3000:]
    return done.stdout


def library_of(name):
    """Path of a library of the compiler."""
    return subprocess.run(["g++", f"-print-file-name={name}"], capture_output=True, text=True).stdout.strip()


@pytest.fixture(scope="module")
def known():
    return outcome()


@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_sanitizers_find_nothing_and_the_bits_stay(tmp_path, monkeypatch, known):
    """At the level of instructions of this processor: the others have the same source."""
    monkeypatch.setattr(
        build, "LEVELS", {name: options for name, options in build.LEVELS.items() if name == host.level()}
    )
    watched = build.build_host(tmp_path, ["-fsanitize=address,undefined", "-fno-sanitize=vptr", "-O1", "-g"])
    preload = f"{library_of('libasan.so')} {library_of('libubsan.so')}"
    assert outcome(watched, LD_PRELOAD=preload, ASAN_OPTIONS="detect_leaks=0:verify_asan_link_order=0") == known


@pytest.mark.skipif(not shutil.which("clang++"), reason="needs clang++")
def test_another_compiler_gives_the_same_bits(tmp_path, monkeypatch, known):
    monkeypatch.setenv("CXX", "clang++")
    assert outcome(build.build_host(tmp_path)) == known


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


@pytest.mark.parametrize("name", COMPILED)
def test_another_layout_is_refused(name, monkeypatch):
    *numbers, last = COMPILED[name]
    monkeypatch.setitem(COMPILED, name, (*numbers, last + 1))
    with pytest.raises(lk.InputError, match=rf"layout\.py and {name} in .* differ"):
        host.require_layout(host.library())


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


@pytest.mark.parametrize(
    "call",
    [
        lambda: host.sort_by_number(np.array([0, 3]), 3),
        lambda: host.sort_by_number(np.array([-1]), 3),
        lambda: host.sort_by_number(np.array([np.nan]), 3),
        lambda: host.take_rows(np.zeros((2, 64)), 0, np.array([128])),
        lambda: host.take_rows(np.zeros((0, 64)), 0, np.array([0])),
        lambda: host.find_touching([[0, 4]], np.zeros((1, 3)), np.zeros((4, 3)), np.ones(4), np.eye(3)),
        lambda: carry([[9], [0]], [[0], [1]], [0]),
        lambda: carry([[0], [1]], [[0], [-4]], [0]),
        lambda: carry([[0], [1]], [[0], [1]], [64]),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_an_index_that_does_not_exist_never_reaches_the_host(call):
    with pytest.raises(ValueError, match="an array contains indices that are not from 0 to"):
        call()


def carry(old, new, slot):
    """Carry the history of one old pair to one new pair in one block."""
    past = History(np.array(old), np.zeros((1, 3), np.int32), np.zeros((1, 1)), np.ones(1, bool), np.arange(4))
    host.carry_history(past, np.array(new), np.zeros((1, 3)), np.array(slot), np.ones(1), np.zeros((1, 2, 64)))


def test_a_grid_of_other_grains_never_reaches_the_host():
    grid = sort_grains(np.zeros((3, 3)), np.eye(3), 0.5)
    with pytest.raises(ValueError, match="the grid does not contain the grains"):
        host.search_grid(np.ones((4, 4)), np.eye(3), grid, 0.0)


FORMS = {
    "strided": lambda a: np.repeat(a, 2, axis=0)[::2],
    "backwards": lambda a: a[::-1].copy()[::-1],
    "columns first": np.asfortranarray,
    "misaligned": lambda a: np.frombuffer(b"x" + a.tobytes(), np.uint8)[1:].view(a.dtype).reshape(a.shape),
    "big-endian": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "wide": lambda a: a.astype(np.longdouble if a.dtype.kind == "f" else np.int64),
}


@pytest.mark.parametrize("form", FORMS)
def test_an_array_in_another_form_gives_the_same_bits(form, small):
    def digest(state):
        engine = FusedEngine(state)
        engine.advance(20, np.diag([0.0, 0.0, -80.0]))
        return engine.state().digest()

    names = ("position", "velocity", "radius", "cell", "contact_grain", "contact_shift", "tangential_force")
    assert digest(small.replace(**{name: FORMS[form](getattr(small, name)) for name in names})) == digest(small)


@pytest.fixture(scope="module")
def small():
    random = np.random.default_rng(4)
    position = (np.indices((6, 6, 6)).reshape(3, -1).T + 0.1 * random.random((216, 3))) * 1.9e-4
    loaded = FusedEngine(grains_in_cell(lk.Scene(), np.full(216, 1e-4), position, np.eye(3) * 6 * 1.9e-4))
    loaded.advance(20, np.diag([0.0, 0.0, -80.0]))
    return loaded.state()


@pytest.mark.parametrize("name", ["position", "radius", "cell", "contact_grain", "contact_shift", "tangential_force"])
def test_an_array_that_the_user_changes_after_the_start_does_not_matter(name, small):
    mine = small.replace(**{name: getattr(small, name).copy()})
    engines = FusedEngine(small), FusedEngine(mine)
    getattr(mine, name)[...] = -7
    for engine in engines:
        engine.advance(20, np.diag([0.0, 0.0, -80.0]))
    found, known = (engine.state() for engine in engines)
    assert found.digest() == known.digest() and np.array_equal(engines[0].stress(), engines[1].stress())


@pytest.mark.parametrize("width", [1e-3, 1e-8, 1e-14])
def test_a_cell_far_too_small_for_its_grains_is_refused_at_once(width, small):
    with pytest.raises(lk.PhysicsError, match="the cell is too small"):
        FusedEngine(small.replace(cell=width * small.cell))


@pytest.mark.filterwarnings("ignore:.* encountered")
@pytest.mark.parametrize("skin", [np.nan, np.inf, 1e5])
def test_an_impossible_reach_is_refused_at_once(skin, small):
    with pytest.raises(lk.PhysicsError, match="too many others within"):
        FusedEngine(small, skin=skin)


def test_one_grain_far_too_large_for_the_others_is_refused_at_once():
    radius = np.full(100_000, 1e-5)
    radius[0] = 1e-2
    position = np.random.default_rng(1).random((len(radius), 3)) * 2.5e-2
    with pytest.raises(lk.PhysicsError, match="the largest grain too large for the others"):
        FusedEngine(grains_in_cell(lk.Scene(), radius, position, np.eye(3) * 2.5e-2))


def test_more_pairs_than_a_computer_can_hold_are_refused(monkeypatch):
    monkeypatch.setattr(host, "MOST_PAIRS", 1000)
    grains = np.concatenate([np.random.default_rng(1).random((300, 3)), np.ones((300, 1))], axis=1)
    grid = sort_grains(grains[:, :3], np.eye(3), 2.0)
    with pytest.raises(lk.PhysicsError, match=r"more than 60,000 pairs of grains .* the cell is too small"):
        host.search_grid(grains, np.eye(3), grid, 0.0)


@pytest.mark.parametrize("number", [0, -1, 2.0, "2", True, float("nan"), None, -(2**63)])
@pytest.mark.parametrize("name", ["fused", "yade"])
def test_a_number_of_threads_that_is_none_is_refused(name, number):
    with pytest.raises(lk.InputError, match=r"threads .*is not valid: give a whole number of at least 1"):
        lk.engines.Device(name, number)


LIMIT = """
import resource
def leave(megabytes):
    now = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + megabytes * 2**20,) * 2)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of the memory")
def test_a_search_without_memory_is_an_error_of_python():
    """An exception that leaves the library would end the process; LLVM's compiler needs the memory before."""
    program = """
import numpy as np
from labkit.engines.kernel import host
from labkit.engines.kernel.neighbours import Grid
one = np.ones(3, np.int64)
grid = Grid(np.zeros(1, np.int64), np.zeros((1, 3), np.int64), np.array([0, 1]), one, 10**6 * one)
host.library(), leave(300)
try:
    host.search_grid(np.ones((1, 4)), np.eye(3), grid, 0.0)
except MemoryError as error:
    print(error)
"""
    done = run_program(LIMIT + program)
    assert done.stdout == "the memory does not suffice for so many grains\n", (done.returncode, done.stderr)


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of the memory")
def test_threads_that_the_system_does_not_start_are_done_without():
    """OpenMP would end the process; the stacks of the threads are larger than the memory left."""
    program = """
import numpy as np
from labkit.engines.fused import FusedEngine
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
random = np.random.default_rng(4)
position = (np.indices((20, 20, 20)).reshape(3, -1).T + 0.1 * random.random((8000, 3))) * 1.9e-4
def digest(threads):
    engine = FusedEngine(grains_in_cell(Scene(), np.full(8000, 1e-4), position, np.eye(3) * 20 * 1.9e-4), threads)
    engine.thread_choice.count = threads
    engine.advance(5, np.diag([0.0, 0.0, -1.0]))
    return engine.state().digest()
known = digest(1)
leave(400)
print(digest(2) == known)
"""
    words = ["sh", "-c", 'ulimit -s 1000000; exec "$0" "$@"', sys.executable, "-P", "-c", LIMIT + program]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "True\n" and "the system starts no more" in done.stderr, (done.returncode, done.stderr)


DAMAGES = {
    "empty": lambda file: os.truncate(file, 0),
    "half": lambda file: os.truncate(file, file.stat().st_size // 2),
    "overwritten": lambda file: file.write_bytes(b"\xcc" * file.stat().st_size),
    "another library": lambda file: file.write_bytes(Path(find_spec("netCDF4._netCDF4").origin).read_bytes()),
    "deleted": lambda file: file.unlink(),
}


@pytest.mark.skipif(sys.platform != "linux", reason="needs a file in memory")
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_library_that_is_changed_while_it_is_used_does_not_matter(damage, tmp_path):
    file = tmp_path / "libhost.so"
    shutil.copy(host.library_file(), file)
    library = host.load_library(file)
    DAMAGES[damage](file)
    assert library.processor_level() == host.library().processor_level()
    with pytest.raises(lk.InputError, match=r"libhost.so is damaged: delete it"):
        host.load_library(file)


@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_a_damaged_library_is_compiled_again(tmp_path, monkeypatch):
    monkeypatch.setattr(build, "LEVELS", {})  # in less time
    monkeypatch.setattr(build, "OPTIONS", ["-O0", "-std=c++17", "-fPIC"])
    file = build.build_host(tmp_path)
    good = file.read_bytes()
    file.write_bytes(good[:-500])
    assert build.build_host(tmp_path) == file and len(file.read_bytes()) == len(good)


def test_two_versions_beside_each_other_use_one_cache(tmp_path):
    """The other version has another law; each must give its own bits, again and again."""
    shutil.copytree(ROOT / "labkit", tmp_path / "labkit", ignore=shutil.ignore_patterns("__pycache__"))
    law = tmp_path / "labkit/grains/laws/normal.py"
    law.write_text(law.read_text().replace("return stiffness * overlap", "return 1.5 * stiffness * overlap"))
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": ""}
    brief = PROGRAM.replace("in LAWS", "in LAWS[:1]").replace('("double", "mixed")', '("double",)')
    found = [outcome(cwd=where, program=brief, **cache) for where in (ROOT, tmp_path, ROOT, tmp_path)]
    assert found[0] == found[2] != found[1] == found[3]


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
    engine.thread_choice.count = 2
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


def test_a_quote_without_its_partner_in_the_environment_is_said(monkeypatch):
    monkeypatch.setenv("CXX", 'g++ "-O2')
    with pytest.raises(build.CannotCompile, match=r"CXX=.* has a quote without its partner"):
        build.compiler()
    monkeypatch.setenv(mpi.LAUNCHER, "srun 'x")
    with pytest.raises(lk.InputError, match=rf"{mpi.LAUNCHER}=.* has a quote without its partner"):
        mpi.launcher()
