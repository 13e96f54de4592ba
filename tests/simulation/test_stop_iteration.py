"""A StopIteration in user code within a run, which Python would call a generator's, is named with its place."""

import pytest

import labkit as lk
from labkit.quantities.recorded import STATISTICS

PATH = lk.paths.ConstantVolume(strain=0.004)


def take_first(*_):
    return next(iter(()))


PLACES = {"statistic": ("statistic", PATH, False), "progress": (None, PATH, take_first)}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("in_file", [True, False])
@pytest.mark.parametrize("engine", ["fused", pytest.param("yade", marks=[pytest.mark.yade, pytest.mark.slow])])
def test_it_is_named(engine, in_file, place, loose_specimen, monkeypatch, tmp_path):
    statistic, path, progress = PLACES[place]
    if statistic:
        monkeypatch.setattr(STATISTICS, "_entries", dict(STATISTICS._entries))
        lk.register_statistic("first")(take_first)
    file = tmp_path / "r.run.nc" if in_file else None
    with pytest.raises(lk.InputError, match=r"test_stop_iteration.py line \d+, in take_first: StopIteration: give"):
        lk.run(loose_specimen, path, engine=engine, file=file, progress=progress)
    assert not list(tmp_path.glob(".*"))


def test_it_is_named_in_a_consolidation(loose_specimen):
    with pytest.raises(lk.InputError, match="in take_first: StopIteration"):
        lk.consolidate(loose_specimen, pressure=2e6, progress=take_first)
