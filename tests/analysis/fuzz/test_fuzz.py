"""A few cases of `./lab fuzz` with fixed seeds, and a check that the harness finds the faults it looks for."""

import argparse
import collections
import csv
import json
import os
import random
import signal
import time
from dataclasses import replace

import pytest

import labkit as lk
from analysis.fuzz import extremes, kills, soak
from analysis.fuzz.cases import in_child
from analysis.fuzz.command import Log, Search, add_options, main
from analysis.fuzz.damage import damaged
from labkit.process.interruption import end_on_signals
from tests.conftest import PATIENCE

pytestmark = pytest.mark.long


def test_a_small_share_of_each_class_ends_as_it_should(tmp_path, capsys):
    parser = argparse.ArgumentParser()
    add_options(parser)
    words = "--files 4 --options 6 --campaigns 3 --seed 7 -o".split()
    assert main(parser.parse_args([*words, str(tmp_path)]), "./lab fuzz") == 0, capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "counts.csv").open()))
    kinds = collections.Counter({row["class"]: 0 for row in rows})
    for row in rows:
        kinds[row["class"]] += int(row["cases"])
    assert kinds["state"] == kinds["run"] == kinds["checkpoint"] == kinds["packing.txt"] == 4
    assert kinds["campaign files"] == 3 and kinds["options"] == 6
    assert sorted(file.name for file in tmp_path.iterdir()) == ["counts.csv", "manifest.json"]


def test_a_command_that_was_stopped_goes_on(tmp_path):
    file = tmp_path / "unfinished.txt"
    with pytest.raises(KeyboardInterrupt), Log(file, 7) as log:
        log.add("files", "refused")
        log.add("options", "INPUT CHANGED s.state.nc")
        raise KeyboardInterrupt
    with Log(file, 8) as log:
        assert log.of("files") == []
    with pytest.raises(KeyboardInterrupt), Log(file, 7) as log:
        log.add("files", "refused")
        raise KeyboardInterrupt
    with Log(file, 7) as log:
        assert log.of("files") == ["refused"] and log.of("options") == []
    assert not file.exists()


def test_extremes_are_refused_or_right(monkeypatch):
    names = ("usual grains", "p = 1 GPa", "27 grains, 3x3x3", "density 1e9, E = 1 Pa")
    cases = (replace(case, limit=PATIENCE) for case in extremes.CASES if case.name in names)
    monkeypatch.setattr(extremes, "CASES", tuple(cases))
    found = {case.name: outcome for case, outcome, _ in extremes.outcomes("fused")}
    assert found == dict(zip(names, ["correct", "refused", found["27 grains, 3x3x3"], "refused"], strict=True))
    assert found["27 grains, 3x3x3"] in ("correct", "limit reported")


def test_a_killed_command_is_repeated_until_it_ends(monkeypatch):
    jobs = kills.jobs("fused")[1:3]  # a consolidation and a run
    monkeypatch.setattr(kills, "jobs", lambda engine: jobs)
    monkeypatch.setattr(kills, "LIMIT", PATIENCE)
    chains = list(kills.chains("fused", 3, 5))
    assert sum(chain.kills for chain in chains) == 3 and not any(chain.problems for chain in chains)


def wrong():
    raise KeyError("a bug")


@pytest.mark.parametrize(
    "do, outcome",
    [
        (lambda: "same", "same"),
        (lambda: time.sleep(2 * PATIENCE), "HANG"),
        (lambda: os.kill(os.getpid(), signal.SIGKILL), f"CRASH {-signal.SIGKILL}"),
        (wrong, "CRASH 0"),
    ],
)
def test_the_outcome_of_a_case_is_that_of_its_process(do, outcome):
    assert in_child(do, limit=1.0 if outcome == "HANG" else PATIENCE) == outcome


def test_a_wrong_outcome_is_shrunk_kept_and_tried_first_the_next_time(tmp_path, capsys):
    """The planted fault is a reader that does not notice a byte above 200."""
    search = Search(
        "planted", damaged(bytes(1000)), lambda made: "OTHER NUMBERS" if max(made, default=0) > 200 else "same"
    )
    counts = search.run(200, 1, tmp_path)
    assert counts["OTHER NUMBERS"] == 1 and counts.total() < 200
    (kept,) = tmp_path.glob("planted-*")
    assert max(kept.read_bytes()) == 201 and f"planted: OTHER NUMBERS; kept in {kept}" in capsys.readouterr().out
    assert search.run(1, 2, tmp_path) == {"OTHER NUMBERS": 1}


def test_a_signal_to_a_job_that_is_starting_ends_the_job_alone(tmp_path):
    """The job used to inherit the handlers of its parent, and removed the parent's folder as it ended."""
    job = kills.Job("info", ("info", "none.nc"))
    with end_on_signals():
        child = kills.start_job(job, tmp_path, before=lambda: os.kill(os.getpid(), signal.SIGTERM))
        assert kills.wait_for_job(child, PATIENCE) == -signal.SIGTERM


def test_a_soak_finds_what_is_not_whole(soft_specimen, tmp_path):
    names = ("1.out.state.nc", "2.out.state.nc", "3.out.csv", "4.out.state.nc")
    whole, cut, empty, flipped = (tmp_path / name for name in names)
    for file in (whole, cut, flipped):
        lk.write_state(file, soft_specimen)
    cut.write_bytes(cut.read_bytes()[:-500])
    empty.write_bytes(b"")
    content = bytearray(flipped.read_bytes())
    content[-1000] ^= 1  # within the last array
    flipped.write_bytes(content)
    assert [len(soak.faults_of(file, None)) for file in (whole, cut, empty, flipped)] == [0, 1, 1, 1]
    assert not soak.faults_of(cut, cut) and not soak.faults_of(flipped, flipped)  # they were damaged on purpose


@pytest.fixture(scope="module")
def soaked(tmp_path_factory):
    """A soak with one command on fused, the shortest."""
    with pytest.MonkeyPatch.context() as patch:
        one = [job for job in kills.jobs("fused") if job.words[:2] == ("run", "cv")][:1]
        for module in (kills, soak):
            patch.setattr(module, "jobs", lambda engine: one)
        patch.setattr(soak, "yade_program", lambda: None)
        patch.setitem(soak.GIVEN, "soak", {"specimens": [], "runs": [], "others": []})
        yield soak.Soak(tmp_path_factory.mktemp("soak"))


@pytest.mark.parametrize("fault", soak.FAULTS)
def test_a_command_survives_each_fault_of_a_soak(fault, soaked):
    one = soaked.round(soaked.jobs[0], fault, random.Random(f"7 {fault}"))
    assert one.problems == [] and len(one.codes) == 1 + (fault == "two writers")


def test_a_soak_notices_another_result_and_a_changed_file_of_somebody_else(soaked, monkeypatch):
    job = soaked.jobs[0]
    other = replace(job, words=(*job.words[:-2], "--rate", "20", *job.words[-2:]))
    assert soaked.round(job, "nothing", random.Random(1)).problems == []
    soaked.clear(soaked.place / job.output)
    soaked._good[other] = soaked._good[job]
    assert soaked.round(other, "nothing", random.Random(1)).problems == ["another result"]
    monkeypatch.setattr(soak, "start_job", lambda *_, **__: kills.start_job(kills.Job("info", ("info",)), soaked.place))
    monkeypatch.setattr(soak, "PRECIOUS", "of somebody else")
    arrange = soaked.arrange
    monkeypatch.setattr(
        soaked, "arrange", lambda *given: (arrange(*given), (soaked._other / "theirs").write_text(""))[0]
    )
    found = soaked.round(job, "read-only folder", random.Random(1)).problems
    assert any("changed a file of somebody else" in problem for problem in found)


def test_a_soak_that_was_stopped_goes_on():
    done = [soak.Round(["info"], "nothing", [0], [], 30.0)]
    assert [soak.Round(**json.loads(one.to_json())) for one in done] == done
    assert next(soak.rounds(1, 5, done)) is done[0]
