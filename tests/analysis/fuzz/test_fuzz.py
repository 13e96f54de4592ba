"""A small share of `./lab fuzz` with fixed seeds, and whether the harness finds what it looks for."""

import argparse
import csv
import os
import random
import signal
import time

import pytest

from analysis.fuzz.cases import Case, in_child
from analysis.fuzz.command import main
from analysis.fuzz.damage import DAMAGES, damaged


def test_a_small_share_of_each_class_ends_as_it_should(tmp_path, capsys):
    options = argparse.Namespace(minutes=1, files=18, options=15, campaigns=5, seed=7, output=str(tmp_path))
    assert main(options, "./lab fuzz") == 0, capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "counts.csv").open()))
    assert sum(int(row["cases"]) for row in rows) == 38
    assert sum(int(row["refused"]) for row in rows if row["class"].startswith(("state", "run", "checkpoint"))) == 18
    assert sorted(file.name for file in tmp_path.iterdir()) == ["counts.csv", "counts.csv.provenance.json"]


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
