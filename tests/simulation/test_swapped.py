"""Functions of the front door answer arguments of another kind, or in another order, before they compute anything."""

import pandas
import pytest

import labkit as lk

KINDS = {"strain_kind": "logarithmic", "stress_kind": "effective", "source": "a test", "licence": "none"}
FILE = {
    "write_state": (lambda s, r: lk.write_state(s, "x.state.nc"), r"write labkit.write_state\('s.state.nc', state\)"),
    "read_state": (lambda s, r: lk.read_state(s), "write labkit.read_state"),
    "read_state without a name": (lambda s, r: lk.read_state(None), "NoneType is not a file name"),
    "open_run": (lambda s, r: lk.open_run(r), "write labkit.open_run"),
    "open_state": (lambda s, r: lk.open_state(s), "write labkit.open_state"),
    "Run.open": (lambda s, r: lk.Run.open(r), "write labkit.Run.open"),
    "read_probes": (lambda s, r: lk.read_probes(r), "write labkit.read_probes"),
    "open_campaign": (lambda s, r: lk.open_campaign(["a.run.nc"]), "labkit.open_runs for a list"),
    "read_path": (lambda s, r: lk.read_path(3), "write labkit.read_path"),
    "import_state": (lambda s, r: lk.import_state(s), "write labkit.import_state"),
    "import_snapshot": (lambda s, r: lk.import_snapshot(lk.Scene(), "x.csv"), "write labkit.import_state"),
    "use": (lambda s, r: lk.use(3), "write labkit.use"),
    "read_measured": (
        lambda s, r: lk.read_measured(lk.paths.ConstantVolume(), "x.csv", {}, **KINDS),
        "write labkit.read_measured",
    ),
    "run": (lambda s, r: lk.run(s, lk.paths.ConstantVolume(), file=r), "write file='r.run.nc'"),
    "make_specimen": (lambda s, r: lk.make_specimen(lk.Recipe(0.67, grains=200), file=s), "write file='s.state.nc'"),
}
OBJECT = {
    "write_state": (lambda s, r: lk.write_state("x.state.nc", r), "or run.state"),
    "bond": (lambda s, r: lk.bond("s.state.nc"), "labkit.read_state"),
    "bond with a state": (lambda s, r: lk.bond(s, s), "State is not a Scene"),
    "probe": (lambda s, r: lk.probe(r), "or run.state"),
    "verify": (lambda s, r: lk.verify(s), "the name of a run file"),
    "misfit": (lambda s, r: lk.misfit("a.run.nc", r, {"q": 1.0}), "labkit.Run.open"),
    "write_measured": (lambda s, r: lk.write_measured("m.run.nc", r), "labkit.read_measured"),
    "critical_states": (lambda s, r: lk.critical_states(r), "Run is not a Mapping"),
    "calibrate": (lambda s, r: lk.calibrate({"a": "a.run.nc"}), "labkit.Run.open"),
    "density_limits": (lambda s, r: lk.density_limits(0.5), "labkit.Scene"),
    "specimen_at": (lambda s, r: lk.specimen_at(0.7, lk.Scene(), pressure="300 kPa"), "labkit.Scene"),
    "make_specimen": (lambda s, r: lk.make_specimen(lk.Scene(), lk.Recipe(0.67)), "labkit.Recipe"),
    "consolidate": (lambda s, r: lk.consolidate("300 kPa", s), "labkit.read_state"),
    "run": (lambda s, r: lk.run(lk.paths.ConstantVolume(), s), "labkit.read_state"),
    "run_many": (lambda s, r: lk.run_many(s), r"a list of \(state, path\)"),
    "Element": (lambda s, r: lk.Element("s.state.nc"), "labkit.read_state"),
    "statistics": (lambda s, r: lk.statistics(s), "state.snapshot"),
}


@pytest.fixture(scope="module")
def run(soft_specimen):
    return lk.run(soft_specimen, lk.paths.ConstantVolume(strain=0.002, rate=100), progress=False)


@pytest.mark.parametrize(("call", "words"), [*FILE.values(), *OBJECT.values()])
def test_the_right_call_is_told(call, words, soft_specimen, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(lk.InputError, match=words) as told:
        call(soft_specimen, run)
    assert len(str(told.value).splitlines()) == 1 and not list(tmp_path.iterdir())


def test_critical_states_takes_runs_and_datasets(run):
    both = lk.critical_states({"run": run, "data": run.data}).set_index("run")
    pandas.testing.assert_series_equal(both.loc["run"], both.loc["data"], check_names=False)
