"""An HTML page that shows grains and force chains in 3D, with a slider over the snapshots of a run.

The page is made from viewer.html. It contains its data and programs (WebGL 2) and needs no network. Colours are the
same as in labkit.plugins.pictures.picture.
"""

from __future__ import annotations

import base64
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
from labkit.micro.cells import cell_corners
from labkit.micro.contact_sides import normalised_normal_force
from labkit.micro.grains import over_mean
from labkit.micro.snapshot import Snapshot
from labkit.plugins.pictures.picture import EDGES, RATTLER, STICK, VIEW, caption, grain_colors, ratio_colors
from labkit.results.run import Run

PAGE = Path(__file__).with_suffix(".html")
MOST = 50_000_000  # bytes of a page: browsers become slow beyond it
STEPS = 2**15 - 1  # positions are 16-bit fractions of the largest one


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
    far = max(
        np.linalg.norm(_from_centre(snapshot, cell_corners(snapshot.cell)), axis=1).max() for snapshot in snapshots
    )
    far += 4.0 * max(
        snapshot.radius.max() for snapshot in snapshots
    )  # room for grains and contacts that extend beyond the faces
    radius = snapshots[0].spheres.radius
    low, middle, high = ratio_colors(np.array([0.3, 1.5, 3.0])).tolist()  # the lightest colours would not show on white
    pull = ratio_colors(np.array([-1.5]))[0]
    data: dict[str, object] = {
        "grains": len(radius),
        "radius": _text(radius / far, "<f4"),
        "extent": 1.0,
        "width": STICK * 2.0 * radius.mean() / far,
        "view": VIEW.T.ravel().tolist(),
        "colors": {"low": low, "middle": middle, "high": high, "tension": pull.tolist()},
        "snapshots": [_data(snapshot, far) for snapshot in snapshots],
    }
    stripes = ", ".join(map(_rgb, (low, middle, high)))
    template = Template(PAGE.read_text(encoding="utf-8"))
    words = {"colors": stripes, "alone": _rgb(RATTLER), "tension": _rgb(pull)}
    words["pulls"] = "" if any((snapshot.contacts.normal_force < 0.0).any() for snapshot in snapshots) else "hidden"
    return template.substitute(words, title=html.escape(title), data=json.dumps(data, allow_nan=False))


def _rgb(color: Iterable[float]) -> str:
    """Return a colour as the page writes it."""
    return "rgb({:.0f} {:.0f} {:.0f})".format(*255 * np.array(color))


def _data(snapshot: Snapshot, far: float) -> dict[str, object]:
    """Return the data of one snapshot, with positions as fractions of `far` from the centre of the cell."""
    said, colors, normalised = caption(snapshot), grain_colors(snapshot), normalised_normal_force(snapshot)
    snapshot = snapshot.spheres
    ends = snapshot.contact_ends()
    edges, sides = cell_corners(snapshot.cell)[np.array(EDGES)], 1e3 * np.linalg.norm(snapshot.cell, axis=0)

    def fractions(points: np.ndarray) -> str:
        return _text(np.round(STEPS * np.clip(_from_centre(snapshot, points) / far, -1.0, 1.0)), "<i2")

    return {
        "caption": f"{said};  cell {' x '.join(f'{side:.3g}' for side in sides)} mm",
        "axes": (_from_centre(snapshot, np.vstack([np.zeros(3), snapshot.cell.T])) / far).round(4).tolist(),
        "position": fractions(snapshot.wrapped_position),
        "color": _text(np.round(255 * colors), "u1"),
        "contacts": len(snapshot.contacts),
        "ends": fractions(ends),
        "ratio": _text(over_mean(normalised.mean(axis=1), np.abs(normalised)), "<f4"),
        "edges": fractions(edges),
    }


def _from_centre(snapshot: Snapshot, points: np.ndarray) -> np.ndarray:
    return points - snapshot.cell.sum(axis=1) / 2.0


def _text(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
