"""An HTML page that shows grains and force chains in 3D, with a slider over the snapshots of a run.

The page is made from viewer.html. It contains its data and programs (WebGL 2) and needs no network. Colours are
three of those in labkit.plugins.pictures.picture, and mixtures of them.
"""

from __future__ import annotations

import html
import json
import os
from collections.abc import Iterable
from pathlib import Path
from string import Template

import numpy as np

from labkit.errors import InputError
from labkit.files.atomic import write_text
from labkit.files.writable import require_writable
from labkit.grains.state import State
from labkit.micro.snapshot import Snapshot
from labkit.plugins.pictures.frames import Frames
from labkit.plugins.pictures.picture import RATTLER, ratio_colors
from labkit.results.run import Run

PAGE = Path(__file__).with_suffix(".html")
MOST = 50_000_000  # bytes of a page: browsers become slow beyond it


class Viewer:
    """An HTML page with grains and forces in 3D, which a notebook displays and `write` saves."""

    def __init__(self, source: Run | State | Snapshot | Iterable[Snapshot], title: str = "labkit") -> None:
        """Show all snapshots of a Run, a State, one Snapshot, or several Snapshots of the same grains.

        Raises InputError if there is no snapshot, if positions are unknown, or if the page would exceed 50 MB.
        """
        self.title = title
        self.page = _page(_snapshots(source), title)

    def write(self, file: str | os.PathLike[str]) -> None:
        """Write the page to a file, which any browser opens. Raises InputError if the file cannot be written."""
        require_writable(str(file))
        write_text(file, self.page)

    def _repr_html_(self) -> str:
        """Return the page in a frame, for notebooks."""
        style = "width: 100%; height: 30em; border: 1px solid #ccc"
        return f'<iframe title="{html.escape(self.title)}" style="{style}" srcdoc="{html.escape(self.page)}"></iframe>'


def _snapshots(source: Run | State | Snapshot | Iterable[Snapshot]) -> list[Snapshot]:
    if isinstance(source, State):
        return [source.snapshot()]
    if isinstance(source, Snapshot):
        return [source]
    return list(source.snapshots if isinstance(source, Run) else source)


def _page(snapshots: list[Snapshot], title: str) -> str:
    if not snapshots or any(snapshot.position is None for snapshot in snapshots):
        raise InputError("there is no snapshot with positions of grains: give a State, or a Run that has snapshots")
    size = sum(14 * len(snapshot.spheres.radius) + 21 * len(snapshot.contacts) for snapshot in snapshots)
    if size > MOST:
        raise InputError(f"the page would have {size / 1e6:.0f} MB: give fewer snapshots, e.g. [run.snapshots[-1]]")
    frames = Frames(snapshots)
    data = {**frames.common(), "snapshots": [frames.frame(snapshot) for snapshot in snapshots]}
    return _filled(data, title, any((snapshot.contacts.normal_force < 0.0).any() for snapshot in snapshots))


def empty_page(title: str) -> str:
    """Return a page without snapshots; a window that contains it sends them as messages (see viewer.html)."""
    return _filled({"snapshots": []}, title, tension=True)


def _filled(data: dict[str, object], title: str, tension: bool) -> str:
    """Return the page with its data; `tension` says whether it explains the colour of tension."""
    low, middle, high = ratio_colors(np.array([0.3, 1.5, 3.0])).tolist()  # the lightest colours would not show on white
    pull = ratio_colors(np.array([-1.5]))[0].tolist()
    data["colors"] = {"low": low, "middle": middle, "high": high, "tension": pull, "alone": RATTLER}
    stripes = ", ".join(map(_rgb, (low, middle, high)))
    template = Template(PAGE.read_text(encoding="utf-8"))
    words = {"colors": stripes, "alone": _rgb(RATTLER), "tension": _rgb(pull)}
    words["pulls"] = "" if tension else "hidden"
    return template.substitute(words, title=html.escape(title), data=json.dumps(data, allow_nan=False))


def _rgb(color: Iterable[float]) -> str:
    """Return a colour as the page writes it."""
    return "rgb({:.0f} {:.0f} {:.0f})".format(*255 * np.array(color))
