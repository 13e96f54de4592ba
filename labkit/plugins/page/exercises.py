"""Exercises: tests that preset the page, each with the numbers that labkit gives for it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Literal

from labkit.plugins.page.form import Texts


@dataclasses.dataclass(frozen=True)
class Number:
    """A number of a test: the value of the curve `key` (labkit.plugins.page.panels) at a place of the run."""

    words: str
    key: str
    value: float
    at: Literal["start", "largest", "end"] = "end"

    def of(self, rows: Sequence[Mapping[str, float | None]]) -> float:
        """Return the number of the rows of a run."""
        values = [value for row in rows if (value := row[self.key]) is not None]
        return {"start": values[0], "largest": max(values, key=abs), "end": values[-1]}[self.at]


@dataclasses.dataclass(frozen=True)
class Test:
    """A test of an exercise."""

    title: str
    choices: Texts
    numbers: tuple[Number, ...]

    @property
    def specimen(self) -> str:
        """Name of the file of the specimen: the page loads it, because grains amplify how a computer rounds."""
        specimen = {group: self.choices[group] for group in self.choices if group != "path"}
        return f"{hashlib.sha256(json.dumps(specimen, sort_keys=True).encode()).hexdigest()[:12]}.state.npz"


@dataclasses.dataclass(frozen=True)
class Exercise:
    """A question, the tests that answer it, and the answer."""

    name: str
    title: str
    question: str
    answer: str
    tests: tuple[Test, ...]


RATIO, VOLUME, ERROR = "stress_ratio stress", "volumetric_strain stress", "sff_error stress"
PRESSURE, SHEAR, VOIDS, CONTACTS = "p stress", "q stress", "void_ratio stress", "coordination_number stress"
DENSE = {"grains": "200", "void_ratio": "0.56", "step1_friction": "0", "step1_rolling_friction": "0"}
MEDIUM = {"grains": "200", "void_ratio": "0.62", "step1_friction": "0.05", "step1_rolling_friction": "0.05"}
LOOSE = {"grains": "200", "void_ratio": "0.72", "step1_friction": "0.4", "step1_rolling_friction": "0.3"}
DRAINED = {"name": "cr", "strain": "0.1", "pressure": "200 kPa"}
UNDRAINED = {"name": "cv", "strain": "0.1"}
CONSTANT_P = {"name": "cp", "strain": "0.1", "pressure": "200 kPa"}


def _test(title: str, recipe: Mapping[str, str], path: Mapping[str, str], *numbers: Number, **scene: str) -> Test:
    return Test(
        title, {"recipe": recipe, "scene": scene, "consolidation": {"pressure": "200 kPa"}, "path": path}, numbers
    )


EXERCISES = (
    Exercise(
        "drainage",
        "Drained and undrained",
        "Squeeze a dense and a loose sand from above: once with water that can leave the gaps (drained: the pressure "
        "from the sides stays), once with water that cannot (undrained: the volume stays). Which is strongest?",
        "Dense grains must climb over each other: drained they swell; undrained they cannot, so the pressure between "
        "them rises and they carry more. Loose grains want to fall into the gaps: drained they contract; undrained the "
        "pressure between them vanishes, and with it the strength. That is liquefaction.",
        (
            _test(
                "dense, drained",
                DENSE,
                DRAINED,
                Number("largest q/p", RATIO, 1.325, "largest"),
                Number("volumetric strain at the end, %", VOLUME, -4.736),
            ),
            _test("loose, drained", LOOSE, DRAINED, Number("volumetric strain at the end, %", VOLUME, 3.348)),
            _test("dense, undrained", DENSE, UNDRAINED, Number("mean stress p at the end, kPa", PRESSURE, 1551.0)),
            _test("loose, undrained", LOOSE, UNDRAINED, Number("largest shear stress q, kPa", SHEAR, 90.22, "largest")),
        ),
    ),
    Exercise(
        "critical",
        "One critical state",
        "A dense and a loose sand are sheared far, under the same pressure. Where do their void ratios go?",
        "To the same place: after much shearing the grains have forgotten how they were packed. The state in which "
        "they shear on without any change is the critical state.",
        tuple(
            _test(
                title,
                recipe,
                {**CONSTANT_P, "strain": "0.25"},
                Number("void ratio at the start", VOIDS, start, "start"),
                Number("void ratio at the end", VOIDS, end),
            )
            for title, recipe, start, end in (("dense", DENSE, 0.5583, 0.7251), ("loose", LOOSE, 0.7897, 0.7067))
        ),
    ),
    Exercise(
        "friction",
        "Friction and rolling",
        "What makes sand strong: that grains rub, or that they cannot roll? Change one at a time.",
        "Both: with little friction the contacts slide, and no resistance to rolling helps. With much friction round "
        "grains roll instead of sliding, so friction alone soon adds nothing; resistance to rolling, which stands for "
        "angular grains, adds the rest.",
        (
            _test("slippery", MEDIUM, CONSTANT_P, Number("largest q/p", RATIO, 0.7718, "largest"), friction="0.1"),
            _test(
                "rough, free to roll",
                MEDIUM,
                CONSTANT_P,
                Number("largest q/p", RATIO, 0.9888, "largest"),
                friction="0.4",
                rolling_friction="0",
            ),
            _test(
                "rough, hard to roll",
                MEDIUM,
                CONSTANT_P,
                Number("largest q/p", RATIO, 1.667, "largest"),
                friction="0.4",
                rolling_friction="0.4",
            ),
        ),
    ),
    Exercise(
        "liquefaction",
        "Liquefaction",
        "An earthquake shakes wet sand: q goes up and down, and the water cannot leave. What happens to the pressure "
        "between the grains?",
        "In loose sand each cycle moves load from the grains to the water, until the grains lose their contacts: the "
        "pore pressure ratio r_u reaches one. Dense sand hardly notices the same cycles.",
        tuple(
            _test(
                title,
                recipe,
                {"name": "undrained_cycles", "ratio": "0.4", "cycles": "6"},
                Number("largest pore pressure ratio r_u", "r_u stress", value, "largest"),
            )
            for title, recipe, value in (("loose", LOOSE, 1.0), ("dense", DENSE, 0.01041))
        ),
    ),
    Exercise(
        "anisotropy",
        "Contacts take sides",
        "Shear the box sideways. Do the contacts still point in all directions alike? Watch the rose, and the chains.",
        "No: contacts open in the direction in which the box is stretched and form in the direction in which it is "
        "pressed, so the rose becomes a peanut along the pressed diagonal, with the strong chains in it.",
        (
            _test(
                "simple shear",
                MEDIUM,
                {"name": "simple_shear", "strain": "0.1", "pressure": "200 kPa"},
                Number("anisotropy of the contacts A at the end", "q contact_anisotropy", 1.222),
                Number("contacts per grain at the end", CONTACTS, 3.929),
            ),
        ),
    ),
    Exercise(
        "equation",
        "What C0 says",
        "Equation C0 gets the stress from averages alone: contacts per grain, their directions, the mean force. How "
        "good is it if the grains have about one size, and if they have many?",
        "For grains of about one size it is right within a few percent: averages say nearly all. With many sizes it "
        "fails, because large grains have more contacts and larger forces than the averages know; the equation by "
        "volume counts each grain by its volume and stays right.",
        tuple(
            _test(
                title,
                {**MEDIUM, "void_ratio": voids},
                {**CONSTANT_P, "strain": "0.05"},
                Number("largest error of C0, %", ERROR, c0, "largest"),
                Number("largest error by volume, %", "sff_error_by_volume stress", by_volume, "largest"),
                diameter_spread=spread,
            )
            for title, spread, voids, c0, by_volume in (
                ("about one size", "0.2", "0.62", 4.034, 2.495),
                ("many sizes", "0.6", "0.5", 12.28, 3.402),
            )
        ),
    ),
)
