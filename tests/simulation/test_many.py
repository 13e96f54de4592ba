"""Many tests at once: each as if it were alone, in the order given; failures are values; repeated calls resume."""

import pytest

import labkit as lk

FEW = {"snapshots": 1, "record_strain": 5e-3}


@pytest.fixture(scope="module")
def tests(soft_specimen):
    """Three tests, the second of which fails, because its time step is too large."""
    unstable = soft_specimen.replace(scene=soft_specimen.scene.replace(time_step_factor=3.0))
    cv, cp = lk.paths.ConstantVolume(50.0, strain=0.01), lk.paths.ConstantMeanStress(50.0, strain=0.01)
    return [(soft_specimen, cv), (unstable, cv), (soft_specimen, cp)]


@pytest.mark.filterwarnings("ignore:at the axial strain rate")
def test_each_test_is_as_if_alone_and_a_failure_is_a_value(tests):
    shown = []
    first, failed, last = lk.run_many(tests, workers=2, progress=lambda done, text: shown.append((done, text)), **FEW)
    assert shown[-1] == (1.0, "3 of 3 done")
    assert "time step" in failed.failure and "\n" not in failed.failure and not first.failure and not last.failure
    for outcome, (state, path) in ((first, tests[0]), (last, tests[2])):
        alone = lk.run(state, path, progress=False, **FEW)
        assert outcome.run.data.attrs["data_sha256"] == alone.data.attrs["data_sha256"]


@pytest.mark.filterwarnings("ignore:at the axial strain rate")
def test_tests_may_come_from_an_iterator(tests):
    states, paths = zip(tests[0], tests[2], strict=True)
    outcomes = lk.run_many(zip(states, paths, strict=True), progress=False, **FEW)
    assert [one.run.data.attrs["path"] for one in outcomes] == ["cv", "cp"]
    with pytest.raises(lk.InputError, match="are not pairs"):
        lk.run_many(iter(states), progress=False)


@pytest.mark.filterwarnings("ignore:at the axial strain rate")
def test_a_repeated_call_keeps_what_is_finished(tests, tmp_path):
    written = []
    for _ in range(2):
        outcomes = lk.run_many([tests[2], tests[0]], tmp_path, progress=False, **FEW)
        assert [one.run.data.attrs["path"] for one in outcomes] == ["cp", "cv"]
        written.append([(tmp_path / f"{number}.run.nc").stat().st_mtime_ns for number in range(2)])
    assert written[0] == written[1]
