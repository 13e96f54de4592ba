"""Probes: small increments of strain or stress from one state, in many directions of a plane of strain or stress space.

A probe applies its increment at a rate proportional to 1 - cos, which starts and ends at zero, so the grains hardly
vibrate; they then rest until the dashpots carry no force. Tensors are in Mandel notation (labkit.micro.tensors), which
preserves their lengths and angles.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import COMPONENTS, ROOT2
from labkit.parameters import Number, check_parameters, parameter

# Default amplitudes: in elastic probes so small that contacts neither open nor close, in all other probes large enough
# for contacts to slide; docs/commands.md explains the choice.
AMPLITUDES = {("strain", True): 1e-9, ("strain", False): 1e-4, ("stress", True): 1e-7, ("stress", False): 1e-2}


@dataclasses.dataclass(frozen=True, eq=False)
class Plane:
    """A plane of strain or stress space, or the whole space.

    `axes` (k, 6) are k orthonormal tensors that span the space; in `labels`, @ stands for the symbol of strain or
    stress.
    """

    name: str
    axes: np.ndarray
    labels: tuple[str, ...]

    def directions(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return angles (n,), degrees, and unit tensors (n, 6) of `number` evenly spaced directions.

        A space with more than two axes has two opposite directions along each axis, and no angles.
        """
        if len(self.axes) != 2:
            return np.full(2 * len(self.axes), np.nan), np.concatenate([self.axes, -self.axes])
        angle = np.arange(number) * (360.0 / number)
        return angle, np.stack([np.cos(np.radians(angle)), np.sin(np.radians(angle))], axis=1) @ self.axes


def _plane(name: str, labels: tuple[str, str], *axes: tuple[float, ...]) -> Plane:
    """Return a plane from two orthogonal tensors, (6,) each."""
    return Plane(name, np.array([np.array(axis) / np.linalg.norm(axis) for axis in axes]), labels)


PLANES = {
    plane.name: plane
    for plane in (
        _plane("axisymmetric", (r"\sqrt{2}\,@_r", "@_z"), (1, 1, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0)),
        _plane("biaxial", ("@_x", "@_z"), (1, 0, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0)),
        _plane(
            "deviatoric", (r"(@_x-@_y)/\sqrt{2}", r"(2@_z-@_x-@_y)/\sqrt{6}"), (1, -1, 0, 0, 0, 0), (-1, -1, 2, 0, 0, 0)
        ),
        _plane("xz-shear", (r"(@_z-@_x)/\sqrt{2}", r"\sqrt{2}\,@_{xz}"), (-1, 0, 1, 0, 0, 0), (0, 0, 0, 0, 1, 0)),
        Plane("all", np.eye(6), tuple(f"@_{{{ij}}}" for ij in COMPONENTS)),
    )
}


def plane_of(text: str) -> Plane:
    """Return the plane that `text` names, or the plane spanned by two tensors, given as 12 numbers xx,yy,zz,yz,xz,xy.

    Raises InputError if the text is neither.
    """
    if text in PLANES:
        return PLANES[text]
    allowed = f"one of {', '.join(PLANES)}, or 12 numbers, the components xx,yy,zz,yz,xz,xy of two tensors"
    try:
        axes = np.array([float(part) for part in text.split(",")]).reshape(2, 6) * ([1.0] * 3 + [ROOT2] * 3)
    except ValueError:
        raise InputError("is unknown", field="plane", value=text, allowed=allowed, quoted=True) from None
    q, r = np.linalg.qr(axes.T)
    size = np.linalg.norm(axes, axis=1)
    if not np.isfinite(axes).all() or np.abs(np.diag(r)).min() <= 1e-6 * size.max():
        raise InputError("is not a plane", field="plane", value=text, allowed="two tensors that are not parallel")
    return Plane(text, (q * np.sign(np.diag(r))).T, ("@ : a_1", "@ : a_2"))


@dataclasses.dataclass(frozen=True)
class Probing:
    """Directions, size and duration of a set of probes. Raises InputError for values outside their ranges."""

    plane: str = parameter(
        "axisymmetric",
        help=f"plane of the directions: one of {', '.join(PLANES)} (`all`: along each of the six components and "
        "against it), or the components xx,yy,zz,yz,xz,xy of two tensors, 12 numbers",
    )
    directions: Number[int] = parameter(24, low=2, high=3600, help="number of directions, evenly spaced in the plane")
    kind: str = parameter("strain", choices=("strain", "stress"), help="what is prescribed")
    amplitude: Number[float | None] = parameter(
        None,
        above=0.0,
        high=0.1,
        help="norm of the increments: of strain, or of stress divided by the mean stress (default: 1e-4 for strain and "
        "1e-2 for stress; 1e-9 and 1e-7 for elastic probes)",
    )
    duration: Number[float] = parameter(
        40.0,
        low=5.0,
        high=1e4,
        help="time in which the increment is applied, divided by the time that a shear wave needs to cross the cell",
    )

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)
        plane_of(self.plane)

    def size(self, elastic: bool) -> float:
        """Return the amplitude, or its default."""
        return AMPLITUDES[self.kind, elastic] if self.amplitude is None else self.amplitude
