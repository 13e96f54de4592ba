"""Legends that several panels share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure


def legend_below(figure: Figure, of: Axes | Sequence[Artist], columns: int, **style: Any) -> None:
    """A legend below all panels, with the entries of one panel or with these artists."""
    handles = of.get_legend_handles_labels()[0] if isinstance(of, Axes) else of
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, **style)
