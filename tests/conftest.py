"""Fixtures with real YADE and real files: tests share a small specimen and a small run, which are made once.

The fast tier (`./lab test --fast`) starts no process and takes little time: it has all tests without the marker
`slow`. `./lab test` has all without the marker `long`, and `./lab test --all` has these too. A test whose fixture
starts a process is marked as slow from here, as is one that needs YADE, MPI or a browser, and in every tier an audit
hook fails a test without the marker that starts a process. Likewise for the markers `yade` and `browser`, so that
`-m "not yade"` needs no YADE.
"""

import contextlib
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import labkit
from labkit.engines.kernel.host import library_file
from labkit.files import provenance
from labkit.files.caches import cache_folder
from tests.forked import Forks
from tests.pyodide import folder_of_pyodide

# The same examples in every run, so that a failure is due to a change, and no limits of time, so that it is not due to
# a busy computer. `./lab test --hypothesis-profile search` looks for new examples.
UNHURRIED = {"deadline": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("repeat", derandomize=True, database=None, **UNHURRIED)
settings.register_profile("search", derandomize=False, **UNHURRIED)
settings.load_profile("repeat")

# A user's own settings change no test; tox.ini also leaves out those that Python reads when it starts.
SETTINGS = re.compile(
    "COLUMNS|DISPLAY|LINES|LABKIT_(C|MPIEXEC|PYTHON|RESULTS|USE|YADE)|MPL|NUMBA_|OMP_|PYTHONWARNINGS|XDG_CACHE_HOME"
)
for name in [*filter(SETTINGS.match, os.environ)]:
    del os.environ[name]
if not os.access(os.path.expanduser("~"), os.W_OK):  # other programs say so
    os.environ["HOME"] = str(cache_folder("home"))
if folder := cache_folder("compiled"):  # processes with another home folder load the same compiled code
    os.environ.setdefault("NUMBA_CACHE_DIR", str(folder))

ROOT = Path(__file__).resolve().parents[1]
MARKED = {  # files made by the fixtures of a test
    "slow": {"forks", "labkit_process"},
    "yade": {"specimen_file", "yade_files"},
    "browser": {"browser"},
}
PATIENCE = 1800  # s, the time limit of a command, long enough even on a busy computer
BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # draws without a GPU


AHEAD = "labkit.engines.kernel.ahead"  # may compile beside any test, if the computer is not busy

started = []  # commands of the processes that the current test started


def watch(event, given):
    if event == "subprocess.Popen" and AHEAD not in given[1]:
        started.append(given[1])


def pytest_configure(config):
    provenance.commit(), provenance.machine()  # calls git and uname once per process, here before the hook exists
    with contextlib.suppress(labkit.InputError):  # a test says that there is no compiler
        library_file()  # starts the compiler once
    sys.addaudithook(watch)


def pytest_collection_modifyitems(items):
    for item in items:
        for name, fixtures in MARKED.items():
            if fixtures & set(item.fixturenames):
                item.add_marker(name)
        if hasattr(item, "callspec") and "yade" in map(str, item.callspec.params.values()):
            item.add_marker("yade")
        if any(map(item.get_closest_marker, ("long", "yade", "mpi", "browser"))):
            item.add_marker("slow")


@pytest.fixture(autouse=True)
def starts_no_process(request):
    started.clear()
    yield
    assert not started or request.node.get_closest_marker("slow"), f"mark the test as slow: it starts {started}"


@pytest.fixture(autouse=True)
def starts_without_extensions():
    """A campaign that an earlier test read in this process may have loaded its own."""
    os.environ["LABKIT_USE"] = ""


@pytest.fixture(scope="session", autouse=True)
def signals_reach_processes():
    """A background job, such as these tests, may inherit an ignored SIGINT from its script, or SIGHUP from nohup."""
    for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, usual)


def wait_until(happened, process=None):
    """Wait with PATIENCE until a function returns something true, which is returned, while a process lives."""
    end = time.monotonic() + PATIENCE
    while True:
        ended = process is not None and process.poll() is not None  # a last look after the end
        if found := happened():
            return found
        assert not ended, f"the process ended first, with exit code {process.returncode}"
        assert time.monotonic() < end, f"it did not happen within {PATIENCE} s"
        time.sleep(0.01)


def run_labkit(*words, cwd=None, environment=None):
    """`labkit words` in a new interpreter; the finished process with its output as text."""
    return subprocess.run(
        [sys.executable, "-m", "labkit.cli", *map(str, words)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )


@pytest.fixture(scope="session")
def labkit_process():
    """Like `labkit_command`, but with a new interpreter, for behaviour that depends on its start."""
    return run_labkit


@pytest.fixture(scope="session")
def forks(signals_reach_processes):
    with Forks() as forks:
        yield forks


@pytest.fixture(scope="session")
def labkit_command(forks):
    """Runs `labkit words` in a separate process that has labkit imported; returns it with its output as text."""
    return forks.run


@pytest.fixture(scope="module")
def browser():
    """Function that opens a page in Chromium, given options of its context, with timeouts for a busy computer."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("no Chromium here: apt-get install chromium-headless-shell")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=found, args=SOFTWARE, timeout=1000 * PATIENCE)

        def new_page(**options):
            page = started.new_context(**options).new_page()
            page.set_default_timeout(1000 * PATIENCE)
            return page

        yield new_page
        started.close()


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """Function that makes a file with `make(file)`, once for all processes of the tests, and returns a copy of it."""
    own, shared = tmp_path_factory.mktemp("small"), tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent

    def copy(name, make):
        with open(shared / f"{name}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (shared / name).exists():
                make(shared / name)
        return Path(shutil.copy(shared / name, own))

    return copy


@pytest.fixture(scope="session")
def pyodide():
    """Folder of Pyodide and its NumPy."""
    return folder_of_pyodide()


@pytest.fixture(scope="session")
def browser_wheel(made_once):
    """The wheel of labkit for browsers, with all contact laws."""
    from labkit.plugins.page.site import wheel_for_browsers

    pytest.importorskip("ziglang")
    return made_once(
        f"labkit-{labkit.__version__}-py3-none-any.whl", lambda file: shutil.copyfile(wheel_for_browsers(), file)
    )


@pytest.fixture(scope="session")
def specimen_file(made_once, labkit_command):
    """A specimen of about 300 grains at e = 0.67."""

    def make(file):
        words = ("--void-ratio", 0.67, "--grains", 300, "--seed", 3, "--engine", "yade", "-o", file)
        done = labkit_command("specimen", *words)
        assert done.returncode == 0, done.stderr

    return made_once("small.state.nc", make)


@pytest.fixture(scope="session")
def run_file(made_once, specimen_file, labkit_command):
    """A CV test of the small specimen to 2 % axial strain."""

    def make(file):
        words = ("--strain", 0.02, "--snapshots", 5, "--engine", "yade", "-o", file)
        done = labkit_command("run", "cv", specimen_file, *words)
        assert done.returncode == 0, done.stderr

    return made_once("small.run.nc", make)


@pytest.fixture(scope="session")
def sheared_state(run_file):
    """About 300 grains after 2 % shear at constant volume."""
    import labkit as lk

    return lk.read_state(run_file)


@pytest.fixture(scope="session")
def loose_specimen():
    """About 200 grains at e = 0.67."""
    import labkit as lk

    return lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=200), progress=False)


@pytest.fixture(scope="session")
def soft_specimen():
    """About 200 grains of medium density at 100 kPa."""
    import labkit as lk

    recipe = lk.Recipe(void_ratio=0.66, grains=200)
    return lk.consolidate(lk.make_specimen(recipe, lk.Scene(), progress=False), 1e5, progress=False)


@pytest.fixture(scope="session")
def liquefied_file(tmp_path_factory, soft_specimen):
    """An undrained cyclic triaxial test of the soft specimen, which liquefies."""
    import labkit as lk

    file = tmp_path_factory.mktemp("liquefied") / "cycles.run.nc"
    path = lk.paths.UndrainedCycles(amplitude=40e3, cycles=40, rate=100.0)
    lk.run(soft_specimen, path, file=file, progress=False, snapshots=4, record_strain=4e-4)
    return file


@pytest.fixture(scope="session")
def shear_file(tmp_path_factory, soft_specimen):
    """A simple shear test of the soft specimen to gamma_xz = 0.2."""
    import labkit as lk

    file = tmp_path_factory.mktemp("sheared") / "shear.run.nc"
    path = lk.paths.SimpleShear(strain=0.2, rate=100.0)
    lk.run(soft_specimen, path, file=file, progress=False, snapshots=4, record_strain=4e-3)
    return file
