"""Runs and readers in threads: the netCDF library serves one at a time, which does not affect their results."""

import copy
import gc
import pickle
import subprocess
import sys
import threading

import numpy as np
import pytest
import xarray as xr

import labkit as lk
from labkit.files.library import LIBRARY
from labkit.process.blas import one_blas_thread, thread_switches
from labkit.results.dataset import open_records
from tests.conftest import PATIENCE, ROOT

IN_THREADS = """
import sys
from concurrent.futures import ThreadPoolExecutor
import labkit as lk
import xarray as xr

state_file, run_file, folder = sys.argv[1:]
state = lk.read_state(state_file)
theirs = xr.open_dataset(run_file, cache=False)

def load(k):
    file = f"{folder}/{k}.run.nc" if k % 2 else None
    run = lk.run(state, lk.paths.ConstantVolume(strain=0.002), file=file, save_every=5, progress=False)
    return run.data["stress"].values.tobytes(), run.snapshots[-1].contacts.normal_force.tobytes()

def read(k):
    run = lk.Run.open(run_file)
    ratio = run.data.lab.stress_ratio().values.tobytes(), run.data.lab.sff_error().values.tobytes()
    return lk.read_state(state_file).digest(), *ratio, theirs["strain"].values.tobytes()

alone = {load: load(0), read: read(0)}
with ThreadPoolExecutor(4) as pool:
    tasks = [load if k % 8 == 0 else read for k in range(96)]
    found = list(pool.map(lambda k: tasks[k](k // 8 if tasks[k] is load else k), range(96)))
print(all(one == alone[task] for task, one in zip(tasks, found)), len(found))
"""


@pytest.mark.slow
def test_runs_and_readers_in_threads_give_the_same_bits(specimen_file, run_file, tmp_path):
    words = [sys.executable, "-c", IN_THREADS, specimen_file, run_file, tmp_path]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (0, "True 96\n"), done.stderr


def in_thread(function):
    """Return the result of another thread, or None if it is still waiting after a moment."""
    found = []
    thread = threading.Thread(target=lambda: found.append(function()), daemon=True)
    thread.start()
    thread.join(0.3)
    return thread, found


def test_xarray_waits_for_the_same_lock(run_file):
    """This holds for files opened by labkit or xarray and for copies; the thread that holds the lock may read."""
    run = lk.open_run(run_file)
    theirs = xr.open_dataset(run_file)
    copies = {
        "labkit": run,
        "xarray": theirs,
        "deep": copy.deepcopy(theirs),
        "pickled": pickle.loads(pickle.dumps(run)),
    }
    assert all(one["strain"].variable._in_memory is False for one in copies.values())
    waiting = {}
    with LIBRARY:
        assert float(theirs["time"][0]) == 0.0
        for name, one in copies.items():
            waiting[name] = in_thread(lambda one=one: one["strain"].values)
        assert not any(found for _, found in waiting.values())
    for thread, found in waiting.values():
        thread.join(60)
        np.testing.assert_array_equal(found[0], run["strain"].values)


def test_a_users_function_may_open_files_with_xarray(run_file):
    """`campaign.runs.over(function)` calls it with the records of a run."""
    with open_records(run_file) as records, xr.open_dataset(run_file) as theirs:
        np.testing.assert_array_equal(records["stress"], theirs["stress"])


def test_a_run_leaves_the_collection_of_garbage_to_python(soft_specimen, tmp_path):
    seen = []
    path = lk.paths.ConstantVolume(strain=0.001)
    lk.run(
        soft_specimen, path, file=tmp_path / "r.run.nc", save_every=1, progress=lambda *_: seen.append(gc.isenabled())
    )
    assert seen and all(seen)


def test_one_of_two_tasks_that_ends_leaves_the_other_one_blas_thread():
    before = [count() for count, _ in thread_switches()]
    inside, leave = threading.Event(), threading.Event()

    def task():
        with one_blas_thread():
            inside.set()
            leave.wait(PATIENCE)

    other = threading.Thread(target=task)
    with one_blas_thread():
        other.start()
        inside.wait(PATIENCE)
    assert {count() for count, _ in thread_switches()} <= {1}
    leave.set()
    other.join()
    assert [count() for count, _ in thread_switches()] == before


def test_the_lock_is_not_waited_for_when_python_frees_a_file():
    """A file may be freed while this thread holds xarray's lock, or is taking it: waiting would never end."""
    from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

    with NETCDF4_PYTHON_LOCK:
        assert not LIBRARY.acquire(False)
    with LIBRARY:
        assert LIBRARY.acquire(False)
        LIBRARY.release()
        assert not NETCDF4_PYTHON_LOCK.acquire(False)
    assert NETCDF4_PYTHON_LOCK.acquire(False)
    NETCDF4_PYTHON_LOCK.release()
