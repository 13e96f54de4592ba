"""Tests that must agree to the last bit: on one and two threads, killed and resumed, and computed twice."""

import contextlib
import json

import pytest

from benchmarks import bits, options
from tests.conftest import ROOT

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """Return a function that computes a case of benchmarks/bits.py in its own folder and returns the hashes."""
    folder, known = tmp_path_factory.mktemp("bits"), {}
    with contextlib.chdir(folder):
        bits.command(bits.specimen())

    def compute(name):
        if name not in known:
            (folder / name).mkdir()
            known[name] = bits.compute(name, folder / name, folder / "s.state.nc")
        return known[name]

    return compute


@pytest.mark.parametrize(
    ("one", "other"), [("cp", "two_threads"), ("undisturbed", "killed"), ("undisturbed", "terminated")]
)
def test_threads_and_signals_change_no_bit(computed, one, other):
    assert bits.difference(computed(one), computed(other), tolerant=False) == ""


def test_one_changed_variable_is_named(computed):
    case = computed("cp")
    changed = {**case, "data_sha256": "another", "variables": {**case["variables"], "/stress": "another"}}
    assert bits.difference(case, changed, tolerant=False).startswith("/stress; last record within 0.0")
    assert bits.difference(case, changed, tolerant=True) == ""


def test_every_command_and_option_of_the_last_version_is_there(tmp_path, capsys):
    now = tmp_path / "now.json"
    now.write_text(json.dumps(options.list_names()))
    assert options.compare(ROOT / "results/bits/options.json", now) == 0, capsys.readouterr().out
