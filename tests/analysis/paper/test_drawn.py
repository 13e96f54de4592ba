"""The figures of the paper's tests are those stored in results/paper."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import analysis.paper
from analysis.paper.drawn import OF_RUNS, OTHERS, draw_all

RESULTS = Path(__file__).resolve().parents[3] / "results" / "paper"


def different(first, second):
    """Fraction of the pixels of two pictures that differ by more than font smoothing does; 1 if their sizes differ."""
    first, second = (np.asarray(Image.open(file).convert("L"), dtype=int) for file in (first, second))
    return np.mean(np.abs(first - second) > 60) if first.shape == second.shape else 1.0


@pytest.mark.skipif(not (RESULTS / "runs").is_dir(), reason="results/paper/runs is not there yet")
def test_drawn_figures_are_the_stored_ones(tmp_path):
    for name in ("calibrated.json", "size_groups.nc"):
        (tmp_path / name).symlink_to(RESULTS / name)
    steps = []
    files = list(draw_all(analysis.paper.runs(RESULTS), tmp_path, lambda fraction, text: steps.append(fraction)))
    assert {file.name for file in files} == {*OF_RUNS, *OTHERS} and steps == sorted(steps)
    changed = [file.name for file in files if different(file, RESULTS / file.name) > 1e-3]
    assert not changed, "./lab paper draws these figures differently from the stored ones"
