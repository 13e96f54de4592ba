"""Rigid clumps of spheres: which grains form a body, its geometry, motion and energy.

A State lists the spheres of all clumps as its grains. Code that depends on bodies uses `State.bodies`, which is None if
every grain is a separate body. Define another kind of rigid body as a subclass with additional variables.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy import ndarray

from labkit.bodies.kinds import constant, declare, motion, place
from labkit.errors import ImpossibleError
from labkit.files.schema import Variable

BODY = "the number of the clump of each sphere: 0, 0, 1, 1, 1, 2, ..."
SPHERE = 4.0 / 3.0 * np.pi  # volume of the unit sphere
ROUNDING = 1e-5  # relative error of variables that a file stores in single precision
MORE = 1.0 + ROUNDING
LOOSE = 1e-3  # largest distance of a sphere from its place in a clump, divided by its radius
WRONG = 0.01  # largest relative error of the volume and inertia of a clump, integrated numerically


@declare
@dataclasses.dataclass(frozen=True, eq=False)
class Clumps:
    """Bodies of one or more spheres.

    The spheres of a body are consecutive. The axes of a body are its principal axes, in ascending order of their
    moments of inertia: the first is the long axis. `table` is the schema of the variables in a State and in its files,
    and `of_run` is the schema of the variables in the group `grains` of a run file. Engines change the variables named
    in `moving`.
    """

    table: ClassVar[dict[str, Variable]]
    of_run: ClassVar[dict[str, Variable]]
    moving: ClassVar[tuple[str, ...]]

    body: ndarray = constant("grain", "1", "clump to which the sphere belongs, not decreasing", "i4")
    arm: ndarray = constant("grain i", "m", "centre of the sphere in the principal axes of its clump")
    body_volume: ndarray = constant("clump", "m3", "volume of the clump, overlaps counted once")
    body_inertia: ndarray = constant(
        "clump i", "m5", "principal moments of inertia of the clump over its density, ascending"
    )
    body_position: ndarray = place("clump i", "m", "centre of mass of the clump, not wrapped into the cell")
    body_velocity: ndarray = motion(
        "clump i", "m s-1", "its velocity including the mean field, half a time step earlier"
    )
    orientation: ndarray = place(
        "clump quaternion", "1", "rotation from the principal axes to x, y, z, real part first"
    )
    angular_momentum: ndarray = motion(
        "clump i", "kg m2 s-1", "angular momentum of the clump, half a time step earlier"
    )

    @property
    def arrays(self) -> dict[str, ndarray]:
        """The variables by name."""
        return {name: getattr(self, name) for name in self.table}

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the dimensions that a State of single grains lacks."""
        return {"clump": len(self.body_volume)}

    @property
    def contents(self) -> str:
        """Number of bodies and of their spheres, as text: `302 clumps of 906 spheres`."""
        return f"{len(self.body_volume)} clumps of {len(self.body)} spheres"

    @functools.cached_property
    def first(self) -> ndarray:
        """First sphere of each body, (body,)."""
        return np.searchsorted(self.body, np.arange(len(self.body_volume)))

    @functools.cached_property
    def single(self) -> ndarray:
        """True for bodies of one sphere, (body,), which are treated as ordinary grains."""
        return np.bincount(self.body, minlength=len(self.body_volume)) == 1

    def validate(self) -> Clumps:
        """Return the bodies. Raises ImpossibleError for variables that rigid bodies of spheres cannot have."""
        require, low, middle, high = ImpossibleError.unless, *self.body_inertia.T
        numbered = np.array_equal(np.unique(self.body), np.arange(len(self.body_volume)))
        require(numbered, "body", "does not number the clumps from 0, or lists an empty one", BODY)
        require((np.diff(self.body) >= 0).all(), "body", "does not list the spheres of a clump one after another", BODY)
        unit = np.abs(np.linalg.norm(self.orientation, axis=-1) - 1.0) <= ROUNDING
        require(unit.all(), "orientation", "is not a rotation", "quaternions of length 1")
        require((self.body_volume > 0.0).all(), "body_volume", "is not positive", "the volume of each clump in m3")
        ascending = (low > 0.0) & (low <= MORE * middle) & (middle <= MORE * high) & (high <= MORE * (low + middle))
        allowed = "three positive moments, ascending, in m5, the third at most the sum of the others"
        require(ascending.all(), "body_inertia", "contains moments that no body has", allowed)
        return self

    def require_spheres(self, radius: ndarray, position: ndarray) -> None:
        """Raise ImpossibleError if the bodies do not fit spheres with radii (grain,) and centres (grain, 3), in m."""
        require, volume, inertia = ImpossibleError.unless, self.validate().body_volume, self.body_inertia
        place = self.body_position[self.body] + np.einsum("gij,gj->gi", self.axes()[self.body], self.arm)
        fits = np.abs(position - place).max(axis=1) <= LOOSE * radius
        allowed = "body_position + (rotation by orientation of) arm, or make the clumps with labkit"
        require(fits.all(), "position", "differs from the place of the spheres in their clumps", allowed)
        sphere = np.maximum.reduceat(radius, self.first)
        volumes = SPHERE * np.add.reduceat(radius**3, self.first)
        fits = (volume > (1.0 - WRONG) * SPHERE * sphere**3) & (volume < (1.0 + WRONG) * volumes)
        allowed = "at least the volume of the largest sphere of the clump, at most the sum of all, in m3"
        require(fits.all(), "body_volume", "does not fit the spheres", allowed)
        reach = np.maximum.reduceat(np.linalg.norm(self.arm, axis=1) + radius, self.first)
        least, most = 0.4 * SPHERE * sphere**5, volume * reach**2
        fits = (inertia[:, 0] > (1.0 - WRONG) * least) & (inertia[:, 2] < (1.0 + WRONG) * most)
        allowed = "the moments of the volume of the clump (density 1), in m5"
        require(fits.all(), "body_inertia", "does not fit the spheres", allowed)

    def equivalent_radius(self, radius: ndarray) -> ndarray:
        """Return the radius of a sphere with the volume of each body, (body,), in m; `radius` (grain,) is in m."""
        return np.where(self.single, radius[self.first], np.cbrt(0.75 / np.pi * self.body_volume))

    def axes(self) -> ndarray:
        """Return the principal axes of each body as columns, (body, 3, 3)."""
        return rotation_matrices(self.orientation)

    def at_rest(self) -> Clumps:
        """Return a copy without motion."""
        zero = np.zeros_like(self.body_velocity)
        return dataclasses.replace(self, **dict.fromkeys(self.table.keys() - self.of_run.keys(), zero))

    def for_engine(self, density: float) -> dict[str, ndarray]:
        """Return the arrays, by name, that an engine needs for bodies of two or more spheres.

        `clump` (grain,) is the body of each sphere, or -1 for a single sphere. `clump_mass` (body,) is the mass in kg,
        and `clump_inertia` (body, 3) the principal moments of inertia in kg m2. The other names are the names in
        `moving` with the prefix `clump_`. `density` is the density of the grains (kg/m3).
        """
        several = ~self.single
        return {
            "clump": np.where(several, np.cumsum(several) - 1, -1)[self.body],
            "clump_mass": density * self.body_volume[several],
            "clump_inertia": density * self.body_inertia[several],
            **{f"clump_{name}": getattr(self, name)[several] for name in self.moving},
        }

    def after(
        self, density: float, position: ndarray, velocity: ndarray, spin: ndarray, moved: Mapping[str, ndarray]
    ) -> Clumps:
        """Return the bodies after a motion.

        Args:
            density: Density of the grains (kg/m3).
            position: Positions of all spheres, (grain, 3), in m.
            velocity: Velocities of all spheres, (grain, 3), in m/s.
            spin: Angular velocities of all spheres, (grain, 3), in rad/s.
            moved: Motion of the bodies of two or more spheres, named as in `for_engine`; empty without such bodies.
        """
        first, changed = self.first, {name: getattr(self, name).copy() for name in self.moving}
        changed["body_position"], changed["body_velocity"] = position[first], velocity[first]
        changed["angular_momentum"] = density * self.body_inertia * spin[first]
        for name in self.moving if moved else ():
            changed[name][~self.single] = moved[f"clump_{name}"]
        return dataclasses.replace(self, **changed)

    def fluctuation_velocity(self, gradient: ndarray) -> ndarray:
        """Return the velocity (body, 3) of the centres of mass relative to the mean field, in m/s.

        `gradient` (3, 3), in 1/s, is the velocity gradient of the cell.
        """
        return self.body_velocity - self.body_position @ gradient.T

    def kinetic_energy(self, density: float, spin: ndarray, gradient: ndarray) -> float:
        """Return the rotational energy plus the translational energy relative to the mean field, in J.

        Args:
            density: Density of the grains (kg/m3).
            spin: Angular velocities of all spheres, (grain, 3), in rad/s.
            gradient: Velocity gradient of the cell, (3, 3), in 1/s.
        """
        velocity = self.fluctuation_velocity(gradient)
        translation = density * self.body_volume @ np.einsum("bi,bi->b", velocity, velocity)
        return 0.5 * float(translation + np.einsum("bi,bi->", spin[self.first], self.angular_momentum))

    def largest_eigenvalues(self, K: ndarray, position: ndarray, density: float) -> ndarray:
        """Return the largest eigenvalue of M^-1 K_b for every body, (body,), in the unit of K divided by the unit of M.

        Args:
            K: Stiffness of each sphere while all others are fixed, (grain, 6, 6); see labkit.grains.time_step.
            position: Positions of all spheres, (grain, 3), in m.
            density: Density of the grains (kg/m3).
        """
        arm = position - self.body_position[self.body]
        motion = np.broadcast_to(np.eye(6), K.shape).copy()  # motion of a sphere as its body moves: v + w x arm, w
        motion[:, 0, 4], motion[:, 1, 5], motion[:, 2, 3] = arm[:, 2], arm[:, 0], arm[:, 1]
        motion[:, 0, 5], motion[:, 1, 3], motion[:, 2, 4] = -arm[:, 1], -arm[:, 2], -arm[:, 0]
        of_bodies = np.add.reduceat(motion.transpose(0, 2, 1) @ K @ motion, self.first, axis=0)
        axes = self.axes()
        half = np.zeros_like(of_bodies)  # M^-1/2 in the axes x, y, z
        half[:, :3, :3] = np.eye(3) / np.sqrt(density * self.body_volume)[:, None, None]
        half[:, 3:, 3:] = (axes / np.sqrt(density * self.body_inertia)[:, None]) @ axes.transpose(0, 2, 1)
        return np.linalg.eigvalsh(half @ of_bodies @ half)[:, -1]


def rotation_matrices(quaternion: ndarray) -> ndarray:
    """Return the rotation matrices (..., 3, 3) of unit quaternions (..., 4) with the real part first."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
