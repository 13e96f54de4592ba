"""Makes public functions the first call of labkit in a process, alone and from four threads at the same time.

    python -m tests.results.first_calls STATE RUN FOLDER NAME...

Each call is made in processes forked from this one, which has imported other libraries and nothing of labkit but
its list of names. Prints the calls that do not end as they should, with the traceback or the signal.
"""

import importlib
import os
import signal
import sys
import threading
import traceback

import matplotlib.figure
import netCDF4
import numpy as np
import pandas
import scipy.optimize
import xarray

import labkit as lk

LIBRARIES = matplotlib.figure, netCDF4, pandas, scipy.optimize, xarray
LIMIT = 1800  # s
STATE, RUN, FOLDER = sys.argv[1:4] if __name__ == "__main__" else [""] * 3
QUIET = {"progress": False}


def state():
    return lk.read_state(STATE)


def snapshot():
    return state().snapshot()


def path():
    return lk.paths.ConstantVolume(strain=2e-4)


def at_rest():
    return lk.model.isotropic_state(lk.model.Model(), 0.67, 5e5)


def model_rate(name):
    return getattr(lk.model, name)(lk.model.Model(), at_rest(), np.diag([0.0, 0.0, 1.0]))


def new_file(kind):
    return f"{FOLDER}/{os.getpid()}-{threading.get_ident()}.{kind}"


CALLS = {
    "read_state": state,
    "write_state": lambda: lk.write_state(new_file("state.nc"), state()),
    "open_state": lambda: lk.open_state(STATE),
    "open_run": lambda: lk.open_run(RUN).load(),
    "open_runs": lambda: lk.open_runs(RUN).load(),
    "open_campaign": lambda: lk.open_campaign(RUN).load(),
    "verify": lambda: lk.verify(RUN),
    "critical_states": lambda: lk.critical_states({"a": lk.open_run(RUN)}),
    "make_specimen": lambda: lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=100), lk.Scene(), **QUIET),
    "consolidate": lambda: lk.consolidate(state(), 4.8e5, **QUIET),
    "bond": lambda: lk.bond(state(), state().scene.replace(law="bonded", rolling_friction=0.0)),
    "run": lambda: lk.run(state(), path(), **QUIET),
    "run_many": lambda: lk.run_many([(state(), path())] * 2, workers=2, **QUIET),
    "probe": lambda: lk.probe(state(), elastic=True, directions=2, **QUIET),
    "Element": lambda: lk.Element(state()).strain(np.diag([0.0, 0.0, 1e-6])),
    "love_stress": lambda: lk.love_stress(snapshot()),
    "sff_stress": lambda: lk.sff_stress(snapshot()),
    "sff_stress_by_volume": lambda: lk.sff_stress_by_volume(snapshot()),
    "statistics": lambda: lk.statistics(snapshot()),
    "mean_stress": lambda: lk.mean_stress(np.eye(3)),
    "deviatoric_stress": lambda: lk.deviatoric_stress(np.eye(3)),
    "model.isotropic_state": at_rest,
    "model.drive": lambda: lk.model.drive(lk.model.Model(), lk.model.model_path("cp", 5e5, strain=1e-3), at_rest()),
    "model.state_rate": lambda: model_rate("state_rate"),
    "model.stress_rate": lambda: model_rate("stress_rate"),
    "model.rate_tangent": lambda: model_rate("rate_tangent"),
    "model.hypoplastic_form": lambda: lk.model.hypoplastic_form(lk.model.Model(), at_rest(), directions=20),
    "model.critical_section": lambda: lk.model.critical_section(np.zeros(1)),
}


def call_of(name):
    """The call of a name in CALLS, or of a function of a snapshot in a package, such as `micro.love_stress`."""
    if name in CALLS:
        return CALLS[name]
    package, function = name.split(".")
    return lambda: getattr(importlib.import_module(f"labkit.{package}"), function)(snapshot())


def call_from(call, threads):
    """Calls a function from threads that start together; returns how many calls returned."""
    together, returned = threading.Barrier(threads), []

    def work():
        together.wait()
        try:
            call()
            returned.append(True)
        except Exception:
            traceback.print_exc(file=sys.stdout)

    workers = [threading.Thread(target=work) for _ in range(threads)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return len(returned)


def ends_well(name, threads):
    """Forks a process that makes a call, and waits for its end."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            signal.alarm(LIMIT)
            code = int(call_from(call_of(name), threads) != threads)
        finally:
            sys.stdout.flush()
            os._exit(code)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status:
        print(f"{name} from {threads} threads: exit code {status}", flush=True)


if __name__ == "__main__":
    loaded = {name for name in sys.modules if name.startswith("labkit.")}
    assert not any("kernel" in name or "runs" in name for name in loaded), loaded
    for each in sys.argv[4:]:
        for number in (1, 4) if each in CALLS else (4,):  # a function of a snapshot stores nothing
            ends_well(each, number)
