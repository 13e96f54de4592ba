"""What a contact law says of itself: all that engines, statistics and the energy balance need of it.

A law is one subclass of ContactLaw in one file. Its functions of arrays (stiffness, normal force, energy, dashpots)
serve the statistics and the time step; `pair` is the law itself, one contact in one time step, which the engine `fused`
compiles; `yade` gives YADE's functors of the same law, where YADE has it.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from labkit.dem.laws.vectors import Vector

if TYPE_CHECKING:
    from labkit.dem.scene import Scene
    from labkit.micro.snapshot import Snapshot


class Contact(NamedTuple):
    """One contact at one instant, as `pair` gets it. Vectors point from the first grain (a) to the second (b).

    stiffness: the coefficient of `normal_stiffness`; radius_a, radius_b, overlap: m; inverse: 1/distance, 1/m;
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
    """What a contact does in one step, the result of `pair`.

    force: on a, N (b carries the opposite); torque_a, torque_b: N m; tangential_force, rolling_moment: the history,
    on a; friction_loss, rolling_loss, dashpot_loss: energy taken in this step, J.
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
    """What the kernel computes for a scene. What is None is left out: the kernel is compiled without it.

    constants: numbers of the law; friction, rolling, dashpots: what `pair` gets under these names; damping: Newton's
    local damping; turning: whether `pair` needs velocities and makes torques.
    """

    constants: tuple[float, ...]
    friction: Any
    rolling: Any
    dashpots: Any
    damping: float | None
    turning: bool | None


class YadeLaw(NamedTuple):
    """A contact law in YADE. material: function of a radius, m; geometry, physics, law: functors of an InteractionLoop;
    tangential_force, rolling_moment: names of the history in the physics; losses: names of what friction and rolling
    take in YADE's energy tracker.
    """

    material: Callable[[float], Any]
    geometry: list[Any]
    physics: list[Any]
    law: list[Any]
    tangential_force: str
    rolling_moment: str
    losses: tuple[str, str]


class ContactLaw(abc.ABC):
    """A linear spring normal to the contact, kn = (pi/2) E D* (below Eq. 3), unless a subclass says otherwise.

    name: how scenes, files and the command line call it. Arrays of radii and overlaps may have any shape; SI units.
    """

    name: ClassVar[str]
    description: ClassVar[str] = ""

    def normal_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kn = (pi/2) E D*, D* = Da Db/(Da + Db) (below Eq. 3), N/m. A planar scene has that of two mean grains."""
        if scene.planar:
            return np.pi / 4 * scene.young_modulus * scene.mean_diameter * np.ones_like(radius_a + radius_b)
        return np.pi * scene.young_modulus * radius_a * radius_b / (radius_a + radius_b)

    def tangential_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kt = kn/kappa (below Eq. 3), N/m."""
        return self.normal_stiffness(scene, radius_a, radius_b) / scene.stiffness_ratio

    def rolling_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kr of the rolling spring, N m; zero without one."""
        return np.zeros_like(self.tangential_stiffness(scene, radius_a, radius_b))

    @staticmethod
    def spring(stiffness: float, overlap: float) -> float:
        """Elastic normal force of a contact that overlaps, fn = kn delta (Eq. 1), N. Compiled by the kernel too."""
        return stiffness * overlap

    def normal_force(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> np.ndarray:
        """Elastic normal force of touching grains, N, compression positive."""
        return self.spring(self.normal_stiffness(scene, radius_a, radius_b), overlap)

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Energy of the normal, tangential and rolling springs, J: 1/2 sum of (fn^2/kn + ft^2/kt + M^2/kr)."""
        contacts, scene = snapshot.contacts, snapshot.scene
        a, b = snapshot.radius[contacts.grain[:, 0]], snapshot.radius[contacts.grain[:, 1]]
        tangential = np.einsum("ci,ci->c", contacts.tangential_force, contacts.tangential_force)
        kn = self.normal_stiffness(scene, a, b)
        stored = (contacts.normal_force**2 + scene.stiffness_ratio * tangential) / kn
        return 0.5 * float(np.sum(stored + self._rolling_energy(snapshot, a, b)))

    def _rolling_energy(self, snapshot: Snapshot, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Twice the energy of the rolling springs of each contact, J."""
        moment = snapshot.contacts.rolling_moment
        rolling, kr = np.einsum("ci,ci->c", moment, moment), self.rolling_stiffness(snapshot.scene, radius_a, radius_b)
        return np.divide(rolling, kr, out=np.zeros_like(kr), where=kr > 0.0)

    def dashpots(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of the normal and of the tangential dashpot, N s/m; zero without them."""
        nothing = np.zeros_like(self.normal_stiffness(scene, radius_a, radius_b))
        return nothing, nothing

    def damping_ratio(self, scene: Scene) -> float:
        """Damping ratio of the stiffest mode of a specimen, which lowers the stable time step; 0 without dashpots."""
        return 0.0

    def features(self, scene: Scene) -> Features:
        """What the kernel computes for the scene: here friction, and Newton's local damping."""
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
        """The law: the Response of a contact after a step dt, s, from its history before it.

        Written for numbers and the functions of labkit.dem.laws.vectors alone, because the kernel compiles it. A
        contact whose grains are apart (overlap < 0) must return zeros. friction, rolling and dashpots come from
        `features`; test them with `is not None` before they are used. energy is None where losses are not summed.
        """

    def yade(self, scene: Scene) -> YadeLaw | None:
        """The same law in YADE; None where YADE has none. Called inside YADE alone."""
        return None

    @property
    def labkits(self) -> bool:
        """Whether it is one of labkit's own."""
        return type(self).__module__.startswith("labkit.")

    @property
    def on_yade(self) -> bool:
        """Whether the engine `yade` has this law."""
        return type(self).yade is not ContactLaw.yade
