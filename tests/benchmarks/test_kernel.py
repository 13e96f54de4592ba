"""The tables of the cost of the fused engine, by feature and by specimen size, from real measurements."""

import re

import numpy as np
import pytest

from benchmarks import kernel, sizes
from benchmarks.__main__ import main
from benchmarks.lammps import write_input
from labkit.engines.base import silent
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.grains.time_step import critical_time_step

pytestmark = pytest.mark.slow


def test_every_feature_is_measured_and_compared_with_the_limits_of_the_computer(specimen_file, capsys):
    assert main(["bench", str(specimen_file), "--what", "features", "--steps", "50", "--rounds", "1"]) == 0
    text = capsys.readouterr().out
    state = read_state(specimen_file)
    assert f"{state.number_of_grains} grains, {len(state.contact_grain)} contacts" in text
    rows = dict(re.findall(r"^(\w+ law, .*?|\.\.\. .*?) +([\d.]+) +[\d.]+ +[\d.]+$", text, re.MULTILINE))
    assert list(rows) == [
        "rolling_resistance law, all features",
        "... plus the stress every 5 steps",
        "... without energy sums",
        "... without local damping",
        "... without rolling",
        "... without rolling and friction",
        "spring_dashpot law, all features",
        "... without dashpots",
    ]
    for label in ("neighbour searches: ", "stored pairs: ", "memory traffic in bytes per pair: ", "GFLOP/s"):
        assert label in text


def test_sizes(specimen_file, monkeypatch):
    monkeypatch.setattr(sizes, "ROUNDS", 1)
    state = read_state(specimen_file)
    table = sizes.sizes(state, 2, silent, grains=(300, 1200))
    assert table["grains"].tolist() == [state.number_of_grains, 4 * state.number_of_grains]
    assert np.isfinite(table[["double", "mixed", "memory"]]).all(axis=None)


def test_copies_are_the_same_grains_in_a_larger_cell(specimen_file):
    state = read_state(specimen_file)
    many = kernel.copies(state, (2, 1, 1))
    assert many.number_of_grains == 2 * state.number_of_grains and many.volume == pytest.approx(2 * state.volume)
    assert critical_time_step(many) == pytest.approx(critical_time_step(state), rel=1e-12)


def test_the_lammps_input_has_the_grains_and_the_contact_law(specimen_file, tmp_path):
    """The input is written even if LAMMPS is not installed."""
    state = read_state(specimen_file).replace(scene=Scene(law="spring_dashpot"))
    text = write_input(tmp_path, state, np.array([5.0, 5.0, -10.0]), 100, 20, 50, 1).read_text()
    pair = next(line.split() for line in text.splitlines() if line.startswith("pair_coeff"))
    middle = 0.5 * (state.radius.min() + state.radius.max())
    cn, ct = state.scene.contact_law.tangents(state.scene, middle, middle, np.float64(0.0))[4:]
    values = dict(zip(("kn", "cn", "kt", "share", "mu"), (float(pair[k]) for k in (4, 5, 8, 9, 10)), strict=True))
    kn, kt = state.scene.normal_stiffness(middle, middle), state.scene.tangential_stiffness(middle, middle)
    assert values == pytest.approx({"kn": kn, "cn": cn, "kt": kt, "share": ct / cn, "mu": 0.4}, rel=1e-12)
    assert f"{state.number_of_grains} atoms" in (tmp_path / "grains.data").read_text()
    with pytest.raises(InputError, match="beta_t"):
        write_input(tmp_path, state.replace(scene=Scene(beta_n=0.0)), np.zeros(3), 1, 1, 1, 1)
