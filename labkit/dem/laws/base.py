"""The interface of a contact law: everything that engines, statistics and the energy balance need from it.

A law is one subclass of ContactLaw in one file. Its array functions (stiffness, normal force, energy, dashpots) serve
the statistics and the time step. `pair` is the law for one contact in one time step, compiled by the `fused` engine.
`yade` returns the equivalent functors of YADE, if they exist.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import numpy as np

from labkit.dem.laws.vectors import Vector
from labkit.extensions import is_labkits

if TYPE_CHECKING:
    from labkit.dem.scene import Scene
    from labkit.micro.snapshot import Snapshot


class Contact(NamedTuple):
    """One contact at one instant, the argument of `pair`. Vectors point from the first grain (a) to the second (b).

    stiffness: the result of `normal_stiffness`; radius_a, radius_b, overlap: m; inverse: 1/distance, 1/m;
    branch: b - a, m; normal: branch/distance; velocity: of b relative to a (centres), m/s; spin_a, spin_b: rad/s.
    """

    stiffness: float
    radius_a: float
    radius_b: float
    overlap: float
    inverse: float
    branch: Vector
    normal: Vector
    velocity: Vector
    spin_a: Vector
    spin_b: Vector


class Response(NamedTuple):
    """Forces and losses of a contact in one step, the result of `pair`.

    force: on a, N (the force on b is opposite); torque_a, torque_b: N m; tangential_force, rolling_moment: the history,
    acting on a; friction_loss, rolling_loss, dashpot_loss: energy dissipated in this step, J.
    """

    force: Vector
    torque_a: Vector
    torque_b: Vector
    tangential_force: Vector
    rolling_moment: Vector
    friction_loss: float
    rolling_loss: float
    dashpot_loss: float


class Features(NamedTuple):
    """Parts of a law that the kernel computes for a scene; the kernel is compiled without those that are None.

    constants: parameters of the law; friction, rolling, dashpots: arguments of `pair`; damping: coefficient of local
    damping; turning: True if `pair` needs velocities and produces torques.
    """

    constants: tuple[float, ...]
    friction: Any
    rolling: Any
    dashpots: Any
    damping: float | None
    turning: bool | None


class Tangents(NamedTuple):
    """Tangent stiffnesses, N/m, and coefficients of the dashpots, N s/m, of contacts at given overlaps; any shape."""

    normal: np.ndarray
    tangential: np.ndarray
    normal_dashpot: np.ndarray
    tangential_dashpot: np.ndarray


class YadeLaw(NamedTuple):
    """A contact law in YADE.

    material: function of a radius in m; geometry, physics, law: functors of an InteractionLoop; tangential_force,
    rolling_moment: names of the history variables in the interaction physics; losses: names of the friction and rolling
    dissipation in YADE's energy tracker; loading_step: time step in s of the two steps that find the contacts of a
    loaded state; dissipated: friction, rolling and dashpot losses that a functor sums itself, J.
    """

    material: Callable[[float], Any]
    geometry: list[Any]
    physics: list[Any]
    law: list[Any]
    tangential_force: str
    rolling_moment: str
    losses: tuple[str, str] = ("", "")
    loading_step: float = 0.0
    dissipated: Callable[[], tuple[float, float, float]] = lambda: (0.0, 0.0, 0.0)


class ContactLaw(abc.ABC):
    """Contact law with a linear normal spring, kn = (pi/2) E D* (below Eq. 3), unless a subclass overrides it.

    name: used for the law in scenes, files and on the command line; avoids_ratcheting: True if its slip contains YADE's
    factor (Ra + Rb)/|d| (labkit.dem.ratcheting). Arrays of radii and overlaps may have any shape; SI units.
    """

    name: ClassVar[str]
    description: ClassVar[str] = ""
    avoids_ratcheting: ClassVar[bool] = False

    def normal_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Normal stiffness kn = (pi/2) E D*, D* = Da Db/(Da + Db) (below Eq. 3), N/m.

        In a planar scene it is that of two grains of mean diameter. A law with a nonlinear `spring` returns its
        coefficient, in the unit that `spring` needs. In other scenes it is `pair_stiffness`, unless a subclass
        overrides this function alone.
        """
        if scene.planar:
            return np.pi / 4 * scene.young_modulus * scene.mean_diameter * np.ones_like(radius_a + radius_b)
        stiffness = cast(Callable[[float, np.ndarray, np.ndarray], np.ndarray], self.pair_stiffness)
        return stiffness(self.stiffness_factor(scene), radius_a, radius_b)

    def stiffness_factor(self, scene: Scene) -> float:
        """The first argument of `pair_stiffness`."""
        return float(np.pi * scene.young_modulus)

    @staticmethod
    def pair_stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """Normal stiffness kn of two grains; factor: pi E. Also compiled for GPUs."""
        return factor * radius_a * radius_b / (radius_a + radius_b)

    def tangential_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Tangential stiffness kt = kn/kappa (below Eq. 3), N/m."""
        return self.normal_stiffness(scene, radius_a, radius_b) / scene.stiffness_ratio

    def tangents(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> Tangents:
        """Tangent stiffnesses and dashpots at an overlap, m; they set the time step and the servo."""
        kn = self.normal_stiffness(scene, radius_a, radius_b)
        kt = self.tangential_stiffness(scene, radius_a, radius_b)
        return Tangents(kn, kt, *self.dashpots(scene, radius_a, radius_b))

    def rolling_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Rolling stiffness kr, N m; zero without a rolling spring."""
        return np.zeros_like(self.tangential_stiffness(scene, radius_a, radius_b))

    @staticmethod
    def spring(stiffness: float, overlap: float) -> float:
        """Elastic normal force of overlapping grains, fn = kn delta (Eq. 1), N. Also compiled by the kernel."""
        return stiffness * overlap

    def normal_force(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> np.ndarray:
        """Elastic normal force of touching grains, N, compression positive."""
        spring = cast(Callable[[np.ndarray, np.ndarray], np.ndarray], self.spring)  # applied to arrays here
        return spring(self.normal_stiffness(scene, radius_a, radius_b), overlap)

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Energy of the normal, tangential and rolling springs, 1/2 sum of (fn^2/kn + ft^2/kt + M^2/kr), J."""
        contacts, scene = snapshot.contacts, cast("Scene", snapshot.scene)
        a, b = snapshot.radius[contacts.grain[:, 0]], snapshot.radius[contacts.grain[:, 1]]
        tangential = np.einsum("ci,ci->c", contacts.tangential_force, contacts.tangential_force)
        kn = self.normal_stiffness(scene, a, b)
        stored = (contacts.normal_force**2 + scene.stiffness_ratio * tangential) / kn
        return 0.5 * float(np.sum(stored + self._rolling_energy(snapshot, a, b)))

    def _rolling_energy(self, snapshot: Snapshot, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Twice the energy of the rolling springs of each contact, J."""
        moment = snapshot.contacts.rolling_moment
        rolling = np.einsum("ci,ci->c", moment, moment)
        kr = self.rolling_stiffness(cast("Scene", snapshot.scene), radius_a, radius_b)
        return np.divide(rolling, kr, out=np.zeros_like(kr), where=kr > 0.0)

    def dashpots(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of the normal and the tangential dashpot, N s/m; zero without dashpots."""
        nothing = np.zeros_like(self.normal_stiffness(scene, radius_a, radius_b))
        return nothing, nothing

    def damping_ratio(self, scene: Scene) -> float:
        """Damping ratio of the stiffest mode of a specimen, which reduces the stable time step; 0 without dashpots."""
        return 0.0

    def features(self, scene: Scene) -> Features:
        """Parts that the kernel computes for the scene; by default friction and local damping."""
        friction = scene.friction or None
        return Features(
            (1.0 / scene.stiffness_ratio,), friction, None, None, scene.local_damping or None, friction and True
        )

    @staticmethod
    @abc.abstractmethod
    def pair(
        contact: Contact,
        tangential_force: Vector,
        rolling_moment: Vector,
        dt: float,
        constants: tuple[float, ...],
        friction: Any,
        rolling: Any,
        dashpots: Any,
        energy: Any,
    ) -> Response:
        """The Response of a contact in a time step dt, s, given its history at the start of the step.

        Must use only numbers and the functions of labkit.dem.laws.vectors, because the kernel compiles it, and return
        zeros for grains that do not overlap (overlap < 0). friction, rolling and dashpots come from `features`; test
        them with `is not None` before use. energy is None if losses are not summed.
        """

    def yade(self, scene: Scene) -> YadeLaw | None:
        """The equivalent law in YADE, or None if YADE has none. Called only inside YADE."""
        return None

    @property
    def labkits(self) -> bool:
        """True if the law is part of labkit."""
        return is_labkits(type(self))

    @property
    def on_yade(self) -> bool:
        """True if the `yade` engine supports this law."""
        return type(self).yade is not ContactLaw.yade
