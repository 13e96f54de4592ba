"""What the page draws: the curves of a run against strain, and the rose of contact normals."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from labkit.errors import InputError
from labkit.micro.contact_sides import vectors_of_contacts
from labkit.micro.fabric import normal_density
from labkit.micro.snapshot import Snapshot
from labkit.quantities.recorded import quantity
from labkit.quantities.scalars import Facts, Record

SCALES = {"Pa": ("kPa", 1e-3), "share": ("%", 100.0)}  # SI unit -> shown unit and factor
RATIOS = ("stress_ratio", "sff_error", "sff_error_by_volume")
LEAST_CONTACTS = 2.0  # per grain: with fewer, as in liquefied sand, averages over contacts are noise
BINS = 18  # of the rose, over 180 degrees
NEAR = 0.5  # largest component along y of the contact normals in the rose: 30 degrees from the x-z plane


@dataclasses.dataclass(frozen=True)
class Curve:
    """A quantity of labkit's table along a run.

    `of` is the tensor from which it is computed, instead of the stress; `look` is one of three colours and dashes.
    """

    quantity: str
    legend: str = ""
    of: str = "stress"
    look: int = 0

    @property
    def key(self) -> str:
        """Name of the curve in a row."""
        return f"{self.quantity} {self.of}"

    def value(self, record: Record, facts: Facts) -> float | None:
        """Return the value in the shown unit; None if it has no meaning for this run."""
        try:
            value = float(quantity(self.quantity)({**record, "stress": record[self.of]}, facts))
        except InputError:
            return None
        return self.scale[1] * value if np.isfinite(value) else None

    @property
    def scale(self) -> tuple[str, float]:
        """The shown unit, and the factor from the SI unit."""
        unit = "1" if self.of.endswith("anisotropy") else quantity(self.quantity).unit
        share = self.quantity.endswith("strain") or self.quantity.startswith("sff_error")
        return SCALES.get("share" if share else unit, ("" if unit == "1" else unit, 1.0))

    def axis(self, facts: Facts) -> str:
        """Return the label of an axis."""
        label, (unit, _) = quantity(self.quantity).label(facts), self.scale
        return f"{label} ({unit})" if unit else label


@dataclasses.dataclass(frozen=True)
class Panel:
    """Curves with a common abscissa, the sentence that explains them, and the section of docs/theory.md behind it."""

    title: str
    sentence: str
    theory: str
    x: Curve
    curves: tuple[Curve, ...]
    axis: str = ""  # label of the ordinate, if it is not that of the first curve

    def described(self, facts: Facts) -> dict[str, Any]:
        """Return the panel as JSON, with its labels in a run with these facts."""
        legends = [{"key": curve.key, "legend": curve.legend, "look": curve.look} for curve in self.curves]
        text = {"title": self.title, "sentence": self.sentence, "theory": self.theory}
        axis = self.axis or self.curves[0].axis(facts)
        return {**text, "x": self.x.key, "x_axis": self.x.axis(facts), "y_axis": axis, "curves": legends}


STRAIN = Curve("strain")
SFF = "the-modified-stress-force-fabric-equation-section-4"
DIRECTIONS = "distributions-over-directions-section-3"
PANELS = (
    Panel(
        "Strength",
        "How hard the specimen is sheared, q, for the pressure p on it: from the contact forces (Love), and from two "
        "equations that know only averages over the contacts.",
        SFF,
        STRAIN,
        (
            Curve("stress_ratio", "Love's stress"),
            Curve("stress_ratio", "equation C0", "stress_sff", 1),
            Curve("stress_ratio", "equation by volume", "stress_sff_by_volume", 2),
        ),
    ),
    Panel(
        "Stress path",
        "The way of the specimen through pressure p and shear stress q; a saturated soil that cannot drain loses "
        "pressure where a drained one would contract.",
        "stress-and-its-control",
        Curve("p"),
        (Curve("q", "Love's stress"),),
    ),
    Panel(
        "Volume",
        "Dense grains climb over each other and the specimen swells (negative); loose grains fall into gaps and it "
        "contracts (positive).",
        "symbols",
        STRAIN,
        (Curve("volumetric_strain"),),
    ),
    Panel("Void ratio", "Volume of the gaps over volume of the grains.", "symbols", STRAIN, (Curve("void_ratio"),)),
    Panel(
        "Contacts per grain",
        "The coordination number Z: how many contacts a grain has on average; fewer than four cannot carry a load.",
        "symbols",
        STRAIN,
        (Curve("coordination_number"),),
    ),
    Panel(
        "Anisotropy",
        "How much the directions of the contacts (A) and the forces in these directions (F) prefer the axis of "
        "compression; zero means no preference.",
        DIRECTIONS,
        STRAIN,
        (
            Curve("q", "contact normals A", "contact_anisotropy"),
            Curve("q", "normal forces F", "normal_force_anisotropy", 1),
        ),
        "deviator of A and F",
    ),
    Panel(
        "Error of the equations",
        "Distance of each equation's stress from Love's stress, relative to Love's; zero means that averages say all.",
        SFF,
        STRAIN,
        (Curve("sff_error", "equation C0", look=1), Curve("sff_error_by_volume", "equation by volume", look=2)),
        "error relative to Love's stress (%)",
    ),
    Panel(
        "Pore pressure",
        "Share of the initial pressure that the water carries; at one the grains float: the soil is liquefied.",
        "stress-and-its-control",
        STRAIN,
        (Curve("r_u"),),
    ),
)


def panels(facts: Facts) -> list[dict[str, Any]]:
    """Return the panels that have a meaning for a run with these facts, as JSON."""
    return [
        panel.described(facts)
        for panel in PANELS
        if facts.undrained or not quantity(panel.curves[0].quantity).undrained
    ]


def row(record: Record, facts: Facts) -> dict[str, float | None]:
    """Return the values of all curves at a record; None for ratios of forces where hardly any contact is left."""
    curves = {curve.key: curve for panel in PANELS for curve in (panel.x, *panel.curves)}
    few = float(np.asarray(record["coordination_number"])) < LEAST_CONTACTS
    of_few = {key for key, curve in curves.items() if few and (curve.of != "stress" or curve.quantity in RATIOS)}
    return {key: None if key in of_few else curve.value(record, facts) for key, curve in curves.items()}


def rose(snapshot: Snapshot) -> dict[str, list[float]]:
    """Return the density of contact normals near the x-z plane, over that of contacts in all directions alike.

    `density` (BINS,) is counted, from the z axis towards x over 180 degrees; `fit` (2 BINS + 1,) is the fit of second
    order, 1 + n.A n, in the plane.
    """
    normal = vectors_of_contacts(snapshot).normal
    near = normal[np.abs(normal[:, 1]) < NEAR]
    angle = np.mod(np.arctan2(near[:, 0], near[:, 2]), np.pi)
    counts = np.histogram(angle, BINS, (0.0, np.pi))[0]
    at = np.linspace(0.0, np.pi, 2 * BINS + 1)
    plane = np.stack([np.sin(at), np.zeros_like(at), np.cos(at)], axis=1)
    return {
        "density": (counts * BINS / max(1.0, NEAR * len(normal))).tolist(),
        "fit": normal_density(normal).shape(plane).tolist() if len(normal) else [],
    }
