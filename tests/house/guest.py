"""The settings of a process that a library should leave alone, and a program that uses labkit and looks at them.

    python -m tests.house.guest before|after|alone FOLDER

Prints the settings before and after, as JSON: with `before`, the libraries are imported before labkit is used; with
`after`, labkit is imported first, and only the settings afterwards are printed; with `alone`, labkit is not used.
"""

import atexit
import copyreg
import ctypes
import decimal
import faulthandler
import gc
import importlib
import json
import locale
import logging
import multiprocessing
import os
import random
import resource
import signal
import sys
import threading
import warnings

LIBRARIES = (
    *("numpy", "scipy.linalg", "scipy.special", "pandas", "numba", "netCDF4", "xarray", "xarray.backends.locks"),
    *("matplotlib", "matplotlib.pyplot", "threadpoolctl"),
)


class Allocated(ctypes.Structure):
    """glibc's mallinfo2."""

    _fields_ = [(name, ctypes.c_size_t) for name in "arena ordblks smblks hblks hblkhd a b c d e".split()]


def of_python():
    """Settings of the interpreter and of its standard library."""
    main = threading.current_thread() is threading.main_thread()
    handlers = {str(one): repr(signal.getsignal(one)) for one in signal.valid_signals()}
    yield "signal handlers", handlers
    yield "wakeup", signal.set_wakeup_fd(-1) if main else None
    yield "blocked signals", sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ()))
    yield "timers", [signal.getitimer(one) for one in (signal.ITIMER_REAL, signal.ITIMER_VIRTUAL, signal.ITIMER_PROF)]
    hooks = [
        sys.excepthook,
        sys.unraisablehook,
        sys.displayhook,
        threading.excepthook,
        sys.gettrace(),
        sys.getprofile(),
    ]
    yield "hooks", list(map(repr, hooks))
    yield "limits", [sys.getrecursionlimit(), sys.getswitchinterval(), threading.stack_size(), sys.dont_write_bytecode]
    yield "garbage", [gc.isenabled(), gc.get_threshold(), gc.get_debug(), gc.get_freeze_count()]
    yield "warnings", [list(map(repr, warnings.filters)), repr(warnings.showwarning), repr(warnings.formatwarning)]
    yield "random", repr(random.getstate())
    root = logging.getLogger()
    yield "logging", [root.level, repr(root.handlers), logging.root.manager.disable, logging.raiseExceptions]
    yield "streams", [[repr(one), getattr(one, "errors", None)] for one in (sys.stdin, sys.stdout, sys.stderr)]
    yield "import", [sys.path, list(map(repr, sys.meta_path)), list(map(repr, sys.path_hooks)), sys.argv[2:]]
    yield "start method", multiprocessing.get_start_method(allow_none=True)
    yield "decimal", repr(decimal.getcontext())
    yield "faulthandler", faulthandler.is_enabled()
    yield "pickling", sorted(kind.__name__ for kind in copyreg.dispatch_table)
    yield "at exit", atexit._ncallbacks()
    yield "threads", sorted(one.name for one in threading.enumerate())


def of_system():
    """Settings that the system keeps for a process."""
    yield "environment", dict(os.environ)
    yield "working folder", os.getcwd()
    mask = os.umask(0)
    os.umask(mask)
    yield "umask", mask
    yield "locale", locale.setlocale(locale.LC_ALL, None)
    names = sorted(name for name in dir(resource) if name.startswith("RLIMIT_"))
    yield "resources", {name: resource.getrlimit(getattr(resource, name)) for name in names}
    yield "priority", os.getpriority(os.PRIO_PROCESS, 0)
    yield "cores", sorted(os.sched_getaffinity(0))
    library, number = ctypes.CDLL(None), ctypes.c_int()
    library.prctl(2, ctypes.byref(number))
    yield "dies with its parent", number.value
    yield "allocation", allocation(library)


def allocation(library):
    """Tell whether glibc's rule for large arrays still adapts: it maps none of a size that was freed before."""
    if not hasattr(library, "mallinfo2"):
        return None
    library.mallinfo2.restype, library.malloc.restype = Allocated, ctypes.c_void_p
    library.malloc.argtypes, library.free.argtypes = [ctypes.c_size_t], [ctypes.c_void_p]
    for size in (28 << 20, 24 << 20):
        before = library.mallinfo2().hblks
        block = library.malloc(size)
        mapped = library.mallinfo2().hblks - before
        library.free(block)
    return mapped


def of_libraries(folder):
    """Settings of libraries that labkit uses."""
    import matplotlib
    import netCDF4
    import numba
    import numpy
    import pandas
    import threadpoolctl
    import xarray

    yield "errors of numpy", [numpy.geterr(), repr(numpy.geterrcall()), repr(numpy.get_printoptions())]
    yield "random of numpy", [repr(part) for part in numpy.random.get_state()]
    yield "numba", {name: repr(value) for name, value in vars(numba.config).items() if name.isupper()}
    yield "threads of numba", [numba.get_num_threads(), numba.get_parallel_chunksize()]
    yield "chunk cache", netCDF4.get_chunk_cache()
    yield "locks of HDF5", locked_by_hdf5(f"{folder}/lock{len(os.listdir(folder))}.nc")
    locks = sys.modules["xarray.backends.locks"]
    yield "locks of xarray", [type(getattr(locks, name).lock).__name__ for name in ("HDF5_LOCK", "NETCDFC_LOCK")]
    yield "xarray", {name: repr(value) for name, value in xarray.get_options().items()}
    yield "pandas", {name: pandas.get_option(name) for name in ("display.precision", "mode.string_storage")}
    yield "matplotlib", {name: repr(value) for name, value in matplotlib.rcParams.copy().items()}
    pools = threadpoolctl.threadpool_info()
    yield "threads of OpenBLAS", {one["filepath"]: one["num_threads"] for one in pools if one["prefix"] != "libgomp"}


def locked_by_hdf5(file):
    """True if a netCDF file of the user that is open for writing has a lock of HDF5."""
    import netCDF4

    with netCDF4.Dataset(file, "w"), open("/proc/locks") as locks:
        return str(os.stat(file).st_ino) in {line.split()[5].split(":")[-1] for line in locks}


def use_xarray(file):
    """Write and read a file without labkit: xarray then adds a filter of its own for warnings."""
    import xarray

    xarray.Dataset({"a": ("x", [1.0])}).to_netcdf(file)
    with xarray.open_dataset(file) as data:
        data.load()


def settings(folder):
    """Return all settings, name -> value, also as another thread sees them."""
    for name in LIBRARIES:
        importlib.import_module(name)
    use_xarray(f"{folder}/x{len(os.listdir(folder))}.nc")
    sys.modules["numba"].njit(lambda x: x)(1.0)  # the first compilation adds exit functions of Python and colorama
    seen = {}

    def look(name):
        seen[name] = {key: value for kind in (of_python(), of_system(), of_libraries(folder)) for key, value in kind}

    look("this thread")  # some libraries start when they are asked
    look("this thread")
    other = threading.Thread(target=look, args=["another thread"], name="another thread")
    other.start()
    other.join()
    return json.loads(json.dumps(seen, default=repr, sort_keys=True))


def use_labkit(folder):
    """Use labkit as a library: a specimen, runs in memory, in a file and in threads, figures, the model, commands."""
    import labkit as lk
    from labkit.cli import main
    from labkit.model import Model, drive, isotropic_state
    from labkit.results.xarray_engine import RunFiles  # `labkit`, once it is installed

    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=200), lk.Scene())
    path, file = lk.paths.ConstantMeanStress(pressure="300 kPa", strain=0.002), f"{folder}/a.run.nc"
    runs = [lk.run(state, path), lk.run(state, path, file=file, engine=lk.Fused(min(2, len(os.sched_getaffinity(0)))))]
    many = lk.run_many([(state, path), (state, path)], workers=2)
    assert all(run.complete for run in (*runs, *(one.run for one in many)))
    snapshot = lk.open_run(file).lab.snapshot(-1)
    lk.statistics(snapshot), lk.love_stress(snapshot), lk.sff_stress(snapshot)
    import xarray

    with xarray.open_dataset(file, engine=RunFiles) as data, xarray.open_datatree(file) as tree:
        data["stress"].load(), tree.lab.stress_ratio()
    runs[1].plot().savefig(f"{folder}/a.png")
    lk.verify(runs[0])
    lk.probe(state, directions=2, duration=5).write(f"{folder}/a.probes.nc")
    model, start = Model(), isotropic_state(Model(), 0.67, 3e5)
    drive(model, lk.paths.ConstantVolume(strain=0.01), start)
    for words in (
        ["verify", file, "-o", f"{folder}/b.png"],
        ["info", file],
        ["picture", file, "-o", f"{folder}/c.png"],
    ):
        assert main(words) in (0, 1)  # so few grains may fail a check
    assert main(["info", "--check", f"{folder}/none"]) == 2


if __name__ == "__main__":
    how, where = sys.argv[1:]
    random.seed(1)
    importlib.import_module("numpy").random.seed(1)
    if how == "before":
        start = settings(where)
    if how != "alone":
        use_labkit(where)
    found = settings(where)
    print(json.dumps([start if how == "before" else {}, found]))
