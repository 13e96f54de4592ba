"""The response envelope of probes: the responses to increments of equal size in all directions of a plane."""

from __future__ import annotations

import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labkit.errors import InputError
from labkit.figures.frame import Style, new_panels, plain
from labkit.files.writable import stem
from labkit.plugins.probes.probe_set import Probes
from labkit.results.figures import register_figure

STYLES: dict[str, dict[str, object]] = {
    "grains": {"color": "C0", "marker": "o", "label": "grains"},
    "elastic": {"color": "C2", "ls": ":", "lw": 2.5, "marker": "^", "ms": 8, "mfc": "none"}  # drawn over the grains
    | {"label": "grains without sliding (elastic)"},
    "model": {"color": "C3", "marker": "s", "label": "constitutive model"},
}
AFFINE: dict[str, Style] = {
    "color": "0.4",
    "linestyle": "--",
    "lw": 1.2,
    "label": "all grains move with the mean field",
}
SYMBOL = {"strain": r"\varepsilon", "stress": r"\sigma"}


@register_figure("envelope", needs="probes")
def envelope(data: xarray.Dataset) -> tuple[Figure, pandas.DataFrame]:
    """Draw response envelopes of probes in their plane, and the stiffness in each direction, with the affine bound.

    `data` is the Dataset of Probes (labkit.read_probes(file).data). Raises InputError if the data are not probes, or if
    the directions of the probes do not lie in a plane.
    """
    if "strain_increment" not in data:
        raise InputError("the figure envelope shows probes: give a file written by labkit probe")
    probes = Probes(data)
    if len(probes.plane.axes) != 2:
        raise InputError("has no envelope", field="plane", value=probes.plane.name, allowed="probes in a plane")
    figure, (left, right) = new_panels(1, 2, 5.2, width_ratios=(1.15, 1.0))
    of_stress = probes.kind == "strain"  # the response is a stress
    _affine(left, right, probes, of_stress)
    for material in probes.materials:
        part, style = probes.of(material), {"ms": 3.5, "lw": 1.2} | STYLES[material]
        points = _responses(part, of_stress)
        left.plot(*np.concatenate([points, points[:1]]).T, **style)
        angle, size = part.data["angle"].values, part.directional() * (1e-6 if of_stress else 1e9)
        right.plot([*angle, 360.0], [*size, size[0]], **style)
    _label(left, right, probes, of_stress)
    figure.key(4)
    figure.suptitle(_heading(probes), fontsize=10)
    return figure, probes.table()


def _responses(probes: Probes, of_stress: bool) -> np.ndarray:
    """Return the components of the response along the axes over the size of the increment, (n, 2), MPa or 1/GPa."""
    strain, stress = (probes.along_axes(f"{name}_increment") for name in ("strain", "stress"))
    prescribed, response, factor = (strain, stress, 1e-6) if of_stress else (stress, strain, 1e9)
    return factor * response / np.linalg.norm(prescribed, axis=1)[:, None]


def _affine(left: Axes, right: Axes, probes: Probes, of_stress: bool) -> None:
    """Draw the envelope and the directional stiffness of the affine bound; only for strain probes of grains."""
    C = probes.data["affine_stiffness"].values
    if not of_stress or np.isnan(C).any():
        return
    angle = np.linspace(0.0, 360.0, 181)
    circle = np.stack([np.cos(np.radians(angle)), np.sin(np.radians(angle))], axis=1)
    in_plane = 1e-6 * probes.plane.axes @ C @ probes.plane.axes.T
    left.plot(*(circle @ in_plane).T, **AFFINE)
    right.plot(angle, np.einsum("na,ab,nb->n", circle, in_plane, circle), **AFFINE)


def _label(left: Axes, right: Axes, probes: Probes, of_stress: bool) -> None:
    """Label the axes with names and units."""
    prescribed, response = ("strain", "stress") if of_stress else ("stress", "strain")
    unit = "MPa" if of_stress else "1/GPa"
    names = [label.replace("@", rf"\Delta {SYMBOL[response]}") for label in probes.plane.labels]
    size = rf"|\Delta {SYMBOL[prescribed]}|"
    left.set(xlabel=f"${names[0]} / {size}$ ({unit})", ylabel=f"${names[1]} / {size}$ ({unit})", aspect="equal")
    left.set_title("response envelope", fontsize=10)
    axes = [label.replace("@", SYMBOL[prescribed]) for label in probes.plane.labels]
    right.set(xlabel=f"direction of the {prescribed} increment (degrees)\n0: ${axes[0]}$,  90: ${axes[1]}$")
    product = r"\Delta\sigma:\Delta\varepsilon"
    name = "stiffness" if of_stress else "compliance"
    right.set(ylabel=f"${product} / {size}^2$ ({unit})", xlim=(0.0, 360.0), xticks=range(0, 361, 45))
    right.set_title(f"{name} in the direction of the increment", fontsize=10)
    for panel in (left, right):
        panel.axhline(0.0, color="0.5", lw=0.8)
    left.axvline(0.0, color="0.5", lw=0.8)


def _heading(probes: Probes) -> str:
    """Return the heading: name of the file, number of grains, and stress at the start."""
    attributes = probes.data.attrs
    source = probes.data.encoding.get("source")
    name = plain(f"{stem(source)}: ") if source else ""
    grains = [f"{attributes['grains']} grains"] if "grains" in attributes else []
    stress = probes.data["start_stress"].values[0] / 1e3
    start = "start at " + ", ".join(rf"$\sigma_{k}$ = {stress[i, i]:.0f} kPa" for i, k in enumerate("xyz"))
    return name + ", ".join([f"{probes.kind} probes in the {probes.plane.name} plane", *grains, start])
