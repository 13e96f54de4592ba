"""Errors of the model by path, one point per specimen."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, PercentFormatter

from analysis.model_evidence.calibrations import AMENDED, CALIBRATED, PATHS, TABLE_2
from analysis.paper.drawing import WIDTH
from analysis.places import texts

LABELS: dict[str, str] = texts(__file__)["errors"]
MODELS: Mapping[str, str] = {TABLE_2: "0.6", CALIBRATED: "#0072b2", AMENDED: "#d55e00"}
NAMES: dict[str, str] = texts(__file__)["paths"]


def error_figure(errors: pandas.DataFrame) -> Figure:
    """Errors of Table 2, of the calibrated and of the amended model; a point per specimen, a bar for their mean."""
    figure, panels = plt.subplots(1, len(LABELS), figsize=(WIDTH, 3.0), layout="constrained")
    for axes, (quantity, label) in zip(panels, LABELS.items(), strict=True):
        known = errors[np.isfinite(errors[quantity])]
        paths = [path for path in PATHS if (known["path"] == path).any()]
        for k, (model, color) in enumerate(MODELS.items()):
            own = known[known["model"] == model]
            each = own.groupby(["path", "specimen"])[quantity].mean()
            for x, path in enumerate(paths):
                values = each.get(path, pandas.Series(dtype=float)).to_numpy()
                at = x + 0.25 * (k - 1)
                axes.plot(np.full(len(values), at), values, ".", color=color, ms=4)
                if len(values):
                    axes.hlines(values.mean(), at - 0.1, at + 0.1, color=color, label=model if x == 0 else None)
        axes.set(yscale="log", ylabel=label, xticks=range(len(paths)), xticklabels=[NAMES[path] for path in paths])
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
        axes.yaxis.set_minor_formatter(NullFormatter())
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(MODELS))
    return figure
