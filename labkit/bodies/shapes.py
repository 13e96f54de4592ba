"""Shapes of rigid clumps: spheres with centres and radii, volume and inertia with overlaps counted once.

    @labkit.register_shape
    class Pebble(labkit.Shape):
        name = "pebble"
        centers = ((0, 0, 0), (0.8, 0, 0), (0.3, 0.6, 0))     # in any unit of length: only ratios matter
        radii = (1, 0.7, 0.6)

`Recipe(shape="pebble")` makes a specimen of pebbles, `shape="rod aspect_ratio=1.8"` sets a parameter of the shape, and
`shape="rod, pebble"` mixes both shapes in equal numbers. A clump has the volume of the sphere that it replaces.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, cast

import numpy as np

from labkit.bodies.clumps import Clumps, rotation_matrices
from labkit.errors import InputError
from labkit.extensions import Registry, require_subclass
from labkit.parameters import Number, check_parameters, parameter, parameters_of

MOST = 8  # largest number of spheres in a clump
COLUMNS = 1000  # columns of the integration along each side


class Properties(NamedTuple):
    """A shape in its principal axes, in ascending order of their moments, scaled to the volume of the unit sphere.

    Args:
        arm: Centres of the spheres, (sphere, 3).
        radius: Radii of the spheres, (sphere,).
        inertia: Principal moments of the volume, (3,).
    """

    arm: np.ndarray
    radius: np.ndarray
    inertia: np.ndarray


@dataclasses.dataclass(frozen=True)
class Shape:
    """Spheres that form a clump. A subclass sets `name`, `centers` (sphere, 3) and `radii` (sphere,).

    A shape with parameters is a dataclass that overrides `spheres`.
    """

    name: ClassVar[str]
    centers: ClassVar[Sequence[Sequence[float]]] = ((0.0, 0.0, 0.0),)
    radii: ClassVar[Sequence[float]] = (1.0,)

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)

    def spheres(self) -> tuple[np.ndarray, np.ndarray]:
        """Return centres (sphere, 3) and radii (sphere,), in any unit of length."""
        return np.array(self.centers, dtype=float), np.array(self.radii, dtype=float)


class Sphere(Shape):
    """A single sphere."""

    name = "sphere"


@dataclasses.dataclass(frozen=True)
class Rod(Shape):
    """Equal spheres in a row: a capsule with a wavy surface."""

    name = "rod"
    aspect_ratio: Number[float] = parameter(1.5, low=1.0, high=8.0, help="length divided by width")
    members: Number[int] = parameter(3, low=2, high=MOST, kind=int, help="number of spheres")

    def spheres(self) -> tuple[np.ndarray, np.ndarray]:
        x = np.linspace(-1.0, 1.0, int(self.members)) * (self.aspect_ratio - 1.0)
        return np.stack([x, 0.0 * x, 0.0 * x], axis=1), np.ones_like(x)


@dataclasses.dataclass(frozen=True)
class Tetrapod(Shape):
    """Four equal spheres at the corners of a tetrahedron: compact, without a long axis, and not convex."""

    name = "tetrapod"
    angularity: Number[float] = parameter(
        0.5, above=0.0, high=1.5, help="distance of the centres from the middle divided by the radius: 0 is a sphere"
    )

    def spheres(self) -> tuple[np.ndarray, np.ndarray]:
        corners = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
        return corners * self.angularity / np.sqrt(3.0), np.ones(4)


SHAPES = Registry[type[Shape]](
    "shape", {kind: f"labkit.bodies.shapes:{kind.capitalize()}" for kind in ("sphere", "rod", "tetrapod")}
)


def register_shape(kind: type[Shape]) -> type[Shape]:
    """Register a subclass of Shape under its `name`; use it as a class decorator."""
    require_subclass(kind, Shape)
    return SHAPES.register(kind)


def read_shape(text: str) -> Shape:
    """Return the Shape that a text describes, such as `rod aspect_ratio=1.8 members=4`. Raises InputError."""
    name, *words = text.split() or [""]
    kind = SHAPES.require(name, "shape")
    values = dict(word.partition("=")[::2] for word in words)
    parameters = parameters_of(cast(type, kind))
    for key in sorted(values.keys() - parameters.keys()):
        allowed = f"{name} with {', '.join(f'{name}=...' for name in parameters)}" if parameters else f"{name} alone"
        raise InputError("is not a parameter of this shape", field="shape", value=key, allowed=allowed, quoted=True)
    return kind(**values)


def measure_shape(shape: Shape) -> Properties:
    """Return the Properties of a Shape. Raises InputError unless it consists of 1 to 8 connected spheres."""
    centers, radii = shape.spheres()
    if not (len(radii) and np.shape(centers) == (len(radii), 3) and len(radii) <= MOST and np.min(radii) > 0.0):
        allowed = f"1 to {MOST} spheres: centers (n, 3) and positive radii (n,)"
        raise InputError("has invalid spheres", field="shape", value=shape.name, allowed=allowed)
    near = np.linalg.norm(centers[:, None] - centers, axis=2) <= (1.0 + 1e-9) * (radii[:, None] + radii)
    if not np.linalg.matrix_power(near.astype(float), len(radii)).all():
        raise InputError("falls apart", field="shape", value=shape.name, allowed="spheres that touch")
    return _properties(tuple(map(tuple, centers.tolist())), tuple(radii.tolist()))


@functools.lru_cache
def _properties(centers: tuple[tuple[float, ...], ...], radii: tuple[float, ...]) -> Properties:
    x, r = np.array(centers), np.array(radii)
    if len(r) == 1:
        return Properties(np.zeros((1, 3)), np.ones(1), np.full(3, 8.0 / 15.0 * np.pi))
    volume, center, moment, axes = principal_moments(x, r)
    scale = np.cbrt(4.0 / 3.0 * np.pi / volume)
    return Properties(scale * (x - center) @ axes, scale * r, 4.0 / 3.0 * np.pi * scale**2 * moment)


def principal_moments(
    centers: np.ndarray, radii: np.ndarray, columns: int = COLUMNS
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return the volume of a union of spheres, its centre (3,), and its principal moments (3,) over the volume.

    They are followed by their axes as columns, (3, 3), which are right-handed; arguments as for `moments`.
    """
    volume, first, second = moments(centers, radii, columns)
    center = first / volume
    spread = second / volume - np.outer(center, center)  # second moment of the volume about its centre
    moment, axes = np.linalg.eigh(np.trace(spread) * np.eye(3) - spread)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    return volume, center, moment, axes


def moments(centers: np.ndarray, radii: np.ndarray, columns: int = COLUMNS) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the volume of a union of spheres and its first (3,) and second moments (3, 3).

    The union is divided into columns x columns prisms along z, and each is integrated exactly. With 1000 columns the
    volume and the moments of two spheres are accurate to 1e-5 (measured in tests/bodies/test_shapes.py).
    """
    low, high = (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)
    size = (high - low) / columns
    x, y = (low[k] + (np.arange(columns) + 0.5) * size[k] for k in (0, 1))
    square = radii[:, None, None] ** 2 - (x[:, None] - centers[:, 0, None, None]) ** 2
    half = np.sqrt(np.maximum(square - (y - centers[:, 1, None, None]) ** 2, 0.0))
    order = np.argsort(centers[:, 2, None, None] - half, axis=0)
    start, end = (np.take_along_axis(centers[:, 2, None, None] + s * half, order, axis=0) for s in (-1.0, 1.0))
    top = np.full(half.shape[1:], -np.inf)
    z = [np.zeros_like(top) for _ in range(3)]  # integrals of 1, z and z^2 over the union of the intervals
    for bottom, this in zip(start, end, strict=True):
        bottom, top = np.maximum(bottom, top), np.maximum(this, top)
        for k in range(3):
            z[k] += np.where(top > bottom, (top ** (k + 1) - bottom ** (k + 1)) / (k + 1), 0.0)
    area = size[0] * size[1]
    xs = [x[:, None] ** 0, x[:, None], y]
    first = np.array([(z[0] * xs[1]).sum(), (z[0] * xs[2]).sum(), z[1].sum()])
    second = np.diag([(z[0] * xs[1] ** 2).sum(), (z[0] * xs[2] ** 2).sum(), z[2].sum()])
    second[0, 1] = second[1, 0] = (z[0] * xs[1] * xs[2]).sum()
    second[0, 2] = second[2, 0] = (z[1] * xs[1]).sum()
    second[1, 2] = second[2, 1] = (z[1] * xs[2]).sum()
    return float(z[0].sum() * area), first * area, second * area


def clumps_in_place_of(
    radius: np.ndarray, position: np.ndarray, shapes: Sequence[Shape], seed: int = 0
) -> dict[str, np.ndarray | Clumps]:
    """Return the fields of a State in which clumps of equal volume, with random orientations, replace spheres at rest.

    The shapes occur in random order and equal numbers. Raises InputError for an invalid shape.

    Args:
        radius: Radii of the spheres to replace, (body,), in m.
        position: Centres of the spheres to replace, (body, 3), in m.
        shapes: Shapes of the clumps.
        seed: Random seed.
    """
    rng = np.random.default_rng([seed, 1])
    kinds = [measure_shape(shape) for shape in shapes]
    bodies = len(radius)
    kind = rng.permutation(np.arange(bodies) % len(kinds))
    turn = rng.normal(size=(bodies, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    members = np.array([len(clump.radius) for clump in kinds])[kind]
    turn[members == 1] = (1.0, 0.0, 0.0, 0.0)
    body = np.repeat(np.arange(bodies, dtype=np.int32), members)
    size = radius[body]
    arm = np.concatenate([kinds[k].arm for k in kind]) * size[:, None]
    inertia = np.array([kinds[k].inertia for k in kind]) * radius[:, None] ** 5
    still, zero = np.zeros((bodies, 3)), np.zeros((len(body), 3))
    return {
        "radius": np.concatenate([kinds[k].radius for k in kind]) * size,
        "position": position[body] + np.einsum("gij,gj->gi", rotation_matrices(turn)[body], arm),
        "velocity": zero,
        "angular_velocity": zero,
        "clumps": Clumps(body, arm, 4.0 / 3.0 * np.pi * radius**3, inertia, position, still, turn, still),
    }
