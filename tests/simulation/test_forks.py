"""os.fork in user code: the copy neither removes a lock nor writes a file nor speaks to YADE."""

import os
import sys

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.process.interruption import is_being_written, lock_of, only_writer
from labkit.quantities.recorded import STATISTICS
from tests.simulation.test_stopping import ENGINES, PATH

OPTIONS = {"record_strain": 0.001, "save_every": 1, "snapshots": 0}
REFUSED = 7  # exit status of a copy whose InputError reached the program


def fail():
    raise ValueError("in the copy")


ENDS = {"exits": sys.exit, "raises": fail, "returns": lambda: None}


class Fork:
    """Called in user code: forks at its `when`-th call; the copy ends as ENDS says. Notes what the copy left."""

    def __init__(self, file, end, when=4):
        self.file, self.end, self.left = file, ENDS[end], when
        self.parent, self.states = os.getpid(), []

    def __call__(self, *_):
        self.left -= 1
        if self.left == 0:
            before = self.file.read_bytes() if self.file.exists() else None
            self.child = os.fork()
            if self.child == 0:
                self.end()
                return 0.0
            code = os.waitstatus_to_exitcode(os.waitpid(self.child, 0)[1])
            after = self.file.read_bytes() if self.file.exists() else None
            self.states = [code, lock_of(self.file).exists(), is_being_written(self.file), before == after]
        return 0.0


def in_copies(parent, work):
    """Call a function; a copy that it forks ends here, with REFUSED for an InputError."""
    try:
        return work()
    except BaseException as error:
        if os.getpid() != parent:
            refused = isinstance(error, lk.InputError) and "os._exit" in str(error)
            os._exit(REFUSED if refused else 3)
        raise
    finally:
        if os.getpid() != parent:
            os._exit(0)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("place", ["progress", "statistic", "last report"])
def test_the_copy_leaves_lock_file_and_engine_alone(engine, place, end, loose_specimen, monkeypatch, tmp_path):
    file, whole = tmp_path / "r.run.nc", tmp_path / "whole.run.nc"
    fork = Fork(file, end, when=9 if place == "last report" else 4)
    if place == "statistic":
        monkeypatch.setattr(STATISTICS, "_entries", dict(STATISTICS._entries))
        lk.register_statistic("forking")(fork)
    progress = False if place == "statistic" else fork
    options = {"engine": engine, **OPTIONS}
    in_copies(fork.parent, lambda: lk.run(loose_specimen, PATH, file=file, progress=progress, **options))
    assert fork.states == [REFUSED if end == "returns" else 3, True, True, True]
    assert not lock_of(file).exists()
    lk.run(loose_specimen, PATH, file=whole, progress=False, **options)
    with netCDF4.Dataset(file) as one, netCDF4.Dataset(whole) as other:
        assert one.complete == 1
        np.testing.assert_array_equal(one["stress"][...], other["stress"][...])


@pytest.mark.parametrize("end", ENDS)
def test_the_copy_leaves_an_interrupted_consolidation_alone(end, loose_specimen, tmp_path):
    """The lock is that of the state to be written."""
    file = tmp_path / "c.state.nc"
    fork = Fork(file, end, when=2)

    def consolidate():
        return lk.consolidate(loose_specimen, pressure=2e6, file=file, progress=fork)

    in_copies(fork.parent, consolidate)
    assert fork.states == [REFUSED if end == "returns" else 3, True, True, True]
    assert lk.read_state(file).number_of_grains and os.listdir(tmp_path) == ["c.state.nc"]


def test_a_copy_that_outlives_the_writer_does_not_keep_the_lock(tmp_path):
    """As a worker of a pool whose parent was killed."""
    file = tmp_path / "r.run.nc"
    ready, alive = os.pipe(), os.pipe()
    writer = os.fork()
    if writer == 0:
        with only_writer(file):
            if os.fork() == 0:
                os.close(alive[1])
                os.read(alive[0], 1)  # until the test ends
                os._exit(0)
            os.write(ready[1], b"1")
            os.kill(os.getpid(), 9)
    os.read(ready[0], 1)
    os.waitpid(writer, 0)
    assert not is_being_written(file)
    with only_writer(file):
        pass
    os.close(alive[1])
