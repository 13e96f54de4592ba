"""What `labkit specimen` and `consolidate` print about the stress, and their option --cell."""

import re

import pytest

import labkit as lk
from labkit.cli import main
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import equivalent_stress


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    """A function that runs a command in a new folder and returns what it prints."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        assert main(list(words)) == 0
        return capsys.readouterr().out

    return run


def test_commands_print_the_invariant_q_and_what_is_off_target(printed):
    text = printed("specimen", "--void-ratio", "0.67", "--grains", "150", "-o", "s.state.nc")
    q = float(re.search(r"q \(invariant\) (\S+) Pa", text)[1])
    assert q == pytest.approx(float(equivalent_stress(love_stress(lk.read_state("s.state.nc").snapshot()))), rel=1e-3)
    assert re.search(r"deviation from the mean stress 0\.\d\d% \(sigma_..\)\n", text)
    text = printed("consolidate", "s.state.nc", "--pressure", "300kPa", "-o", "c.state.nc")
    assert re.search(r"deviation from the pressure 0\.\d\d% \(sigma_..\)\n", text)


def test_shear_stresses_that_stay_are_printed_with_the_option_that_removes_them(printed):
    text = printed("specimen", "--void-ratio", "0.67", "--grains", "150", "--cell", "fixed")
    assert "--cell free makes the stress isotropic" in text
    name = re.search(r"^(\S+): grains", text, re.MULTILINE)[1]
    assert name.endswith("_cellfixed.state.nc")
    text = printed("consolidate", name, "--pressure", "300kPa")
    assert re.search(r"deviation from the pressure [1-9].* \(sigma_(yz|xz|xy)\); --cell free makes", text)
    text = printed("consolidate", name, "--pressure", "300kPa", "--cell", "free")
    assert "_p300kPa_cellfree.state.nc: " in text and "--cell free makes" not in text
