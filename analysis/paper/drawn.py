"""All figures of the paper's tests, as files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from analysis.paper import contacts, figures, model_figures
from analysis.paper.drawing import STYLE, Models
from analysis.paper.ends import Runs
from analysis.paper.model_runs import models as read_models
from analysis.places import ROOT
from analysis.stratified.figure import stratified_layer
from labkit.engines import Progress
from labkit.grains import read_state

LAYER = ROOT / "results" / "micro" / "stratified.state.nc"
SHEARED = ("loose", "medium", "dense")


def _evolution(group: str) -> Callable[[Runs, Models], Figure]:
    return lambda runs, models: figures.evolution(runs, models, [f"{group}-{density}" for density in SHEARED])


def _cyclic(runs: Runs, models: Models) -> Figure:
    return figures.evolution(runs, models, ("cyclic-cyclic_loose", "cyclic-cyclic_dense"), "accumulated_strain")


OF_RUNS: dict[str, Callable[[Runs, Models], Figure]] = {
    "fig1.png": figures.fig_1,
    "critical_lines.png": figures.critical_lines,
    "fig4.png": figures.fig_4,
    "fig5.png": figures.fig_5,
    "fig6.png": figures.fig_6,
    "fig7.png": figures.fig_7,
    "isotropic.png": figures.isotropic_statistics,
    "fig8.png": figures.fig_8,
    "evolution_cyclic.png": _cyclic,
    "evolution_cv.png": _evolution("cv"),
    "evolution_cp.png": _evolution("cp_500kPa"),
    "evolution_cr.png": _evolution("cr_500kPa"),
    "strength_shares.png": lambda runs, models: figures.strength_shares(runs),
    "engines.png": lambda runs, models: figures.engines(runs),
}
OTHERS: dict[str, Callable[[Path], Figure]] = {  # figures drawn from other files in the folder, or from none
    "fig2.png": lambda folder: figures.fig_2(contacts.read_size_groups(folder)),
    "fig3.png": lambda folder: stratified_layer(read_state(LAYER)),
    "fig9.png": lambda folder: model_figures.fig_9(),
    "fig10.png": lambda folder: model_figures.fig_10(),
}


def draw_all(runs: Runs, folder: Path, progress: Progress) -> Iterator[Path]:
    """Writes every figure into `folder`, which also contains the data that the figures use; yields the files.

    `progress`: called with (fraction, text).
    """
    models, number = read_models(folder), len(OF_RUNS) + len(OTHERS)
    for k, (name, draw) in enumerate(OF_RUNS.items()):
        progress(k / number, f"drawing {name}")
        with plt.rc_context(STYLE):
            figure = draw(runs, models)
        yield Path(figures.save(figure, folder / name, runs))
    for k, (name, draw_other) in enumerate(OTHERS.items(), len(OF_RUNS)):
        progress(k / number, f"drawing {name}")
        yield Path(figures.save(draw_other(folder), folder / name))
