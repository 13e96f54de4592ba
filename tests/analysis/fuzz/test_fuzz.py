"""A few cases of `./lab fuzz` with fixed seeds, and whether the harness finds the faults that it looks for."""

import argparse
import collections
import csv
import os
import random
import signal
import time

import pytest

import labkit as lk
from analysis.fuzz import extremes, kills, soak
from analysis.fuzz.cases import Case, in_child, in_children
from analysis.fuzz.command import Log, add_options, main
from analysis.fuzz.damage import DAMAGES, damaged

pytestmark = pytest.mark.slow


def test_a_small_share_of_each_class_ends_as_it_should(tmp_path, capsys):
    parser = argparse.ArgumentParser()
    add_options(parser)
    words = "--files 10 --options 15 --campaigns 5 --seed 7 -o".split()
    assert main(parser.parse_args([*words, str(tmp_path)]), "./lab fuzz") == 0, capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "counts.csv").open()))
    kinds = collections.Counter({row["class"].split(":")[0]: 0 for row in rows})
    for row in rows:
        kinds[row["class"].split(":")[0]] += int(row["cases"])
    assert kinds["state"] == kinds["run"] == kinds["checkpoint"] == kinds["packing.txt"] == 10
    assert kinds["campaign files"] == 5 and kinds["options"] == 15 and kinds["run of 0.1.0"] == 10
    sealed = [row for row in rows if row["class"].startswith(("state:", "run:", "checkpoint:"))]
    assert sum(int(row["refused"]) for row in sealed) == 30
    assert sorted(file.name for file in tmp_path.iterdir()) == ["counts.csv", "counts.csv.provenance.json"]


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


def test_a_case_that_ends_its_process_leaves_the_others_as_they_are():
    do = [lambda: "same", lambda: os.kill(os.getpid(), signal.SIGKILL), lambda: "used", lambda: time.sleep(60)]
    cases = [Case("kind", number, one, bytes) for number, one in enumerate([*do, do[0]])]
    assert list(in_children(cases, 5, 1.0)) == ["same", f"CRASH {-signal.SIGKILL}", "used", "HANG", "same"]


def test_extremes_are_refused_or_right(monkeypatch):
    names = ("usual grains", "p = 1 GPa", "27 grains, 3x3x3", "density 1e9, E = 1 Pa")
    monkeypatch.setattr(extremes, "CASES", tuple(case for case in extremes.CASES if case.name in names))
    found = {case.name: outcome for case, outcome, _ in extremes.outcomes("fused")}
    assert found == dict(zip(names, ["correct", "refused", found["27 grains, 3x3x3"], "refused"], strict=True))
    assert found["27 grains, 3x3x3"] in ("correct", "limit reported")


def test_a_killed_command_is_repeated_until_it_ends(monkeypatch):
    jobs = kills.jobs("fused")[1:3]  # a consolidation and a run
    monkeypatch.setattr(kills, "jobs", lambda engine: jobs)
    chains = list(kills.chains("fused", 3, 5))
    assert sum(chain.kills for chain in chains) == 3 and not any(chain.problems for chain in chains)


def wrong():
    raise KeyError("a bug")


@pytest.mark.parametrize(
    "do, outcome",
    [
        (lambda: "same", "same"),
        (lambda: time.sleep(60), "HANG"),
        (lambda: os.kill(os.getpid(), signal.SIGKILL), f"CRASH {-signal.SIGKILL}"),
        (wrong, "CRASH 0"),
    ],
)
def test_the_outcome_of_a_case_is_that_of_its_process(do, outcome):
    assert in_child(Case("kind", 1, do, bytes), limit=1.0) == outcome


@pytest.mark.parametrize("kind", DAMAGES)
def test_damage_is_repeatable_and_changes_the_content(kind):
    content = random.Random(1).randbytes(10_000)
    made = [damaged(content, kind, seed) for seed in range(20)]
    assert made == [damaged(content, kind, seed) for seed in range(20)]
    assert content not in made and len(set(made)) > 10


def test_a_soak_finds_what_is_not_whole(soft_specimen, tmp_path):
    whole, cut, empty = (tmp_path / name for name in ("1.out.state.nc", "2.out.state.nc", "3.out.csv"))
    for file in (whole, cut):
        lk.write_state(file, soft_specimen)
    cut.write_bytes(cut.read_bytes()[:-500])
    empty.write_bytes(b"")
    assert [len(soak.faults_of(file, None)) for file in (whole, cut, empty)] == [0, 1, 1]
    assert not soak.faults_of(cut, cut)  # it was damaged on purpose
