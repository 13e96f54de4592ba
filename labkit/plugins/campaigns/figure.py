"""Overview of a campaign: stress ratio and void ratio of all runs, one column of panels per loading path."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import labkit.results.dataset  # noqa: F401  # registers the accessor .lab
from labkit.figures.frame import as_axis, colors_for, gray_lines, new_panels, plain
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.campaigns.keys import specimen_keys
from labkit.results.dataset import open_records
from labkit.results.verify import SFF_PRESSURE

ENGINE_STYLES: tuple[Literal["-", "--", ":", "-."], ...] = ("-", "--", ":", "-.")
MOST_LABELS = 12  # largest number of entries in the legend
PANEL = 2.8  # size of a panel, inches


def overview(runs: Sequence[tuple[Job, str | Path]]) -> Figure:
    """Draw q/p (above) and void ratio e (below) against the strain of the path, one column per path; a Figure.

    Colour denotes the specimen and, where it varies, the pressure; line style the engine. q/p is left out where p is
    below 50 kPa. The run files are read one at a time.
    """
    labels = _labels([run for run, _ in runs])
    each = [run.loading.name for run, _ in runs], [run.device.name for run, _ in runs], labels
    paths, engines, names = (list(dict.fromkeys(words)) for words in each)
    colors = dict(zip(names, colors_for(len(names)), strict=True))
    styles = {engine: ENGINE_STYLES[number % len(ENGINE_STYLES)] for number, engine in enumerate(engines)}
    width = max(2, len(paths)) * PANEL
    figure, panels = new_panels(2, len(paths), 2 * PANEL, width, squeeze=False, sharex="col", sharey="row")
    for (run, file), label in zip(runs, labels, strict=True):
        column = paths.index(run.loading.name)
        (abscissa, strain), ratio, void_ratio = _curves(file)
        panels[1, column].set_xlabel(abscissa)
        for axes, values in zip(panels[:, column], (ratio, void_ratio), strict=True):
            axes.plot(strain, values, styles[run.device.name], color=colors[label], lw=1.2)
    for axes, path in zip(panels[0], paths, strict=True):
        axes.set_title(plain(path), fontsize=10)
    panels[0, 0].set_ylabel("stress ratio q/p")
    panels[1, 0].set_ylabel("void ratio e")
    lines = [Line2D([], [], color=colors[name], label=plain(name)) for name in names[:MOST_LABELS]]
    lines += [Line2D([], [], color="none", label=f"... {len(names)} in all")] * (len(names) > MOST_LABELS)
    lines += gray_lines(styles if len(engines) > 1 else {})
    columns = int(8.0 * width) // (5 + max(len(str(line.get_label())) for line in lines))  # eight letters per inch
    figure.key(max(1, min(6, columns)), lines)
    return figure


def _labels(runs: Sequence[Job]) -> list[str]:
    """Name the specimen of each run, with the pressure if a path is run on one specimen at several pressures."""
    pressures = [getattr(run.loading, "pressure", None) for run in runs]
    tests = [(run.loading.name, run.specimen, run.device.name) for run in runs]
    vary = len(set(zip(tests, pressures, strict=True))) > len(set(tests))
    return [
        spell_out(run.specimen) + (f", {pressure / 1e3:g} kPa" if vary and pressure is not None else "")
        for run, pressure in zip(runs, pressures, strict=True)
    ]


def spell_out(name: str) -> str:
    """Write the parameters in the name of a specimen as words: `sand, void ratio 0.62, seed 2`.

    The name ends with one part per list in the campaign file, such as -void_ratio0.62 (labkit.text.document), and the
    seed, -s2.
    """
    keys = sorted(specimen_keys(), key=len, reverse=True)
    name = re.sub(r"-p(\d[\d.]*)kPa", r", \1 kPa", name)
    name = re.sub(r"-s(\d+)(?=-|,|$)", r", seed \1", name)
    pattern = re.compile(rf"-({'|'.join(keys)})-?(?=\d)")
    return pattern.sub(lambda part: f", {part[1].replace('_', ' ')} ", name)


def _curves(file: str | Path) -> tuple[tuple[str, np.ndarray], np.ndarray, np.ndarray]:
    """Read the abscissa (label, values), q/p and e of the records of a run file."""
    with open_records(file) as records:
        records = records.set_coords("axial_strain")
        p, q = records.lab.mean_stress().values, records.lab.q().values
        ratio = np.divide(q, p, out=np.full_like(q, np.nan), where=p > SFF_PRESSURE)
        return as_axis(records.lab.abscissa()), ratio, records["void_ratio"].values
