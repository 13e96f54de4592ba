"""The figures of the paper's tests are those stored in results/paper."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

import analysis.paper
from analysis.paper import figures
from analysis.paper.drawing import STYLE
from analysis.paper.drawn import OF_RUNS, OTHERS
from analysis.paper.model_runs import models as read_models

pytestmark = pytest.mark.long

RESULTS = Path(__file__).resolve().parents[3] / "results" / "paper"
OF_ONE_KIND = ("fig1.png", "fig7.png", "evolution_cr.png", "strength_shares.png")


def different(first, second):
    """Fraction of the pixels of two pictures that differ by more than font smoothing does; 1 if their sizes differ."""
    first, second = (np.asarray(Image.open(file).convert("L"), dtype=int) for file in (first, second))
    return np.mean(np.abs(first - second) > 60) if first.shape == second.shape else 1.0


@pytest.mark.skipif(not (RESULTS / "runs").is_dir(), reason="results/paper/runs is not there yet")
def test_drawn_figures_are_the_stored_ones(tmp_path):
    """Draw one figure of each kind, because drawing all takes a minute."""
    for name in ("calibrated.json", "size_groups.nc"):
        (tmp_path / name).symlink_to(RESULTS / name)
    runs, models = analysis.paper.runs(RESULTS), read_models(tmp_path)
    for name in OF_ONE_KIND:
        with plt.rc_context(STYLE):
            figure = OF_RUNS[name](runs, models)
        figures.save(figure, tmp_path / name, runs)
    figures.save(OTHERS["fig2.png"](tmp_path), tmp_path / "fig2.png")
    changed = [name for name in (*OF_ONE_KIND, "fig2.png") if different(tmp_path / name, RESULTS / name) > 1e-3]
    assert not changed, "./lab paper draws these figures differently from the stored ones"
