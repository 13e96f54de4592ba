"""A contact law: a sum of parts, and its interface to engines, statistics and the energy balance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple, cast

import numpy as np

from labkit.extensions import is_labkits
from labkit.grains.laws import links
from labkit.grains.laws.bond import ParallelBond
from labkit.grains.laws.cohesion import Adhesion, Bridge, Neck
from labkit.grains.laws.contact import Features, Response, Tangents
from labkit.grains.laws.damping import Dashpots, LocalDamping
from labkit.grains.laws.kinematics import FirstOrder
from labkit.grains.laws.normal import HertzSpring, LinearSpring
from labkit.grains.laws.pair import Kinematics, compose_pair
from labkit.grains.laws.parts import LawPart, LawParts
from labkit.grains.laws.rolling import Rolling, RollingOfYade, Twisting, TwistingOfYade
from labkit.grains.laws.tangential import Coulomb, Mindlin

if TYPE_CHECKING:
    from labkit.grains.scene import Scene
    from labkit.micro.snapshot import Snapshot


class YadeClass(NamedTuple):
    """A YADE object: the name of its class and its arguments, which may be such objects themselves."""

    name: str
    arguments: Mapping[str, float | str | YadeClass] = {}


class YadeLaw(NamedTuple):
    """A contact law in YADE, as data.

    Args:
        material: Function of a radius, m.
        geometry: Geometry functor of an InteractionLoop.
        physics: Physics functor.
        law: Law functor.
        tangential_force: Name of this history variable in the interaction physics.
        rolling_moment: Name of this history variable in the interaction physics.
        losses: For friction, rolling and damping, the name in YADE's energy tracker and those attributes of the law
            that are added to it, J.
        loading_step: Time step of the two steps that find the contacts of a loaded state, s.
    """

    material: Callable[[float], YadeClass]
    geometry: YadeClass
    physics: YadeClass
    law: YadeClass
    tangential_force: str
    rolling_moment: str
    losses: tuple[tuple[str, tuple[str, ...]], ...]
    loading_step: float = 0.0


class ContactLaw:
    """A contact law. Arrays of radii and overlaps may have any shape; units are SI.

    A law has a `name`, used in scenes, files and on the command line; `parts`, the sum of one part of each kind; and
    `kinematics`, which say how a contact moves in a time step. `avoids_ratcheting` is True if its slip contains YADE's
    factor (Ra + Rb)/|d| (labkit.records.ratcheting).
    """

    name: ClassVar[str]
    description: ClassVar[str] = ""
    parts: ClassVar[LawPart | LawParts] = LinearSpring()
    kinematics: ClassVar[Kinematics] = FirstOrder
    avoids_ratcheting: ClassVar[bool] = False
    normal: ClassVar[LinearSpring]
    tangential: ClassVar[Coulomb]
    rolling: ClassVar[Rolling]
    twisting: ClassVar[Rolling]
    damping: ClassVar[Dashpots]
    cohesion: ClassVar[Adhesion]
    bond: ClassVar[ParallelBond]
    has: ClassVar[frozenset[str]]
    pair: ClassVar[Callable[..., Response]]

    def __init_subclass__(cls) -> None:
        """Take the parts, and compose `pair` from them."""
        super().__init_subclass__()
        parts = cls.parts if isinstance(cls.parts, LawParts) else LawParts(cls.parts)
        for kind, part in DEFAULTS.items():
            setattr(cls, kind, parts.get(kind, part))
        cls.has = frozenset(parts)
        cls.pair = staticmethod(compose_pair(cls.kinematics, *(getattr(cls, kind) for kind in DEFAULTS)))

    def normal_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Coefficient of the normal part: kn, N/m, of a linear spring.

        In a planar scene it is that of two grains of mean diameter.
        """
        if scene.planar:
            radius_a = radius_b = np.full_like(radius_a + radius_b, 0.5 * scene.mean_diameter)
        return links.on_arrays(self.normal.stiffness)(self.normal.factor(scene), radius_a, radius_b)

    def tangential_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Coefficient of the tangential part: kt, N/m, of a linear spring."""
        return self.tangential.share(scene) * self.normal_stiffness(scene, radius_a, radius_b)

    def tangents(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> Tangents:
        """Tangent stiffnesses and dashpots at an overlap, m; they set the time step and the servo.

        With JKR, that of the normal force is an upper bound, Hertz's 2 E* a at the contact radius a.
        """
        coefficient = self.normal_stiffness(scene, radius_a, radius_b)
        kn = links.on_arrays(self.normal.tangent)(coefficient, self._spread(scene, radius_a, radius_b, overlap))
        kt = self._shear_stiffness(scene, radius_a, radius_b, overlap)
        if "bond" in self.has:
            elongation, shear, *_ = links.bond_stiffness(self, scene, radius_a, radius_b)
            kn, kt = kn + elongation, kt + shear
        dashpots = self._dashpots(scene)
        if dashpots is None:
            return Tangents(kn, kt, 0.0 * kn, 0.0 * kt)
        beta_n, beta_t, _ = dashpots
        a, b = scene.mass(radius_a), scene.mass(radius_b)
        reduced = a * b / (a + b)
        return Tangents(kn, kt, beta_n * np.sqrt(reduced * kn), beta_t * np.sqrt(reduced * kt))

    def rolling_stiffness(
        self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray | float = 1.0
    ) -> np.ndarray:
        """Rolling stiffness kr, N m, at an overlap in m if the law is not linear; zero without a rolling part."""
        return self._rotational("rolling", scene, radius_a, radius_b, overlap)

    def twisting_stiffness(
        self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray | float = 1.0
    ) -> np.ndarray:
        """Stiffness against twisting, N m, at an overlap in m if the law is not linear; zero without such a part."""
        return self._rotational("twisting", scene, radius_a, radius_b, overlap)

    def _rotational(
        self, kind: str, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray | float
    ) -> np.ndarray:
        kt = self._shear_stiffness(scene, radius_a, radius_b, overlap)
        if kind not in self.has:
            return np.zeros_like(kt)
        part = getattr(self, kind)
        return kt * part.stiffness(part.numbers(scene, 1.0), 1.0, radius_a, radius_b)

    def _shear_stiffness(
        self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray | float
    ) -> np.ndarray:
        """Stiffness kt of the tangential part at an overlap in m, N/m."""
        spread = self._spread(scene, radius_a, radius_b, overlap)
        coefficient = self.normal_stiffness(scene, radius_a, radius_b)
        return links.on_arrays(self.tangential.stiffness)(self.tangential.share(scene), coefficient, spread)

    def _spread(
        self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray | float
    ) -> np.ndarray:
        """Overlap that gives the stiffness of joined grains, m."""
        if "cohesion" not in self.has:
            return np.maximum(overlap, 0.0)
        numbers, coefficient = self.cohesion.numbers(scene), self.normal_stiffness(scene, radius_a, radius_b)
        return links.on_arrays(self.cohesion.equivalent)(numbers, coefficient, radius_a, radius_b, overlap)

    def reach(self, scene: Scene, radius: np.ndarray) -> float:
        """Largest gap across which grains of these radii act on each other, m; 0 without cohesion or bonds."""
        return links.reach(self, scene, radius.max())

    @property
    def keeps_links(self) -> bool:
        """True if the history of a contact includes its links (labkit.io.links), those of cohesion and bonds."""
        return bool(self.has & {"cohesion", "bond"})

    def normal_force(
        self,
        scene: Scene,
        radius_a: np.ndarray,
        radius_b: np.ndarray,
        overlap: np.ndarray,
        joints: np.ndarray | None = None,
    ) -> np.ndarray:
        """Elastic normal force of contacts, N, compression positive.

        `joints` are their links (n, 8); without them, grains that overlap are joined, and none is bonded.
        """
        coefficient = self.normal_stiffness(scene, radius_a, radius_b)
        force = links.on_arrays(self.normal.force)(coefficient, np.maximum(overlap, 0.0))
        if not self.keeps_links:
            return force
        return force + links.normal_force(self, scene, radius_a, radius_b, overlap, joints)

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Energy of the normal, tangential and rolling springs of all contacts, and of their links, J."""
        snapshot, scene = snapshot.spheres, cast("Scene", snapshot.scene)
        contacts = snapshot.contacts
        a, b = snapshot.radii
        coefficient, overlap = self.normal_stiffness(scene, a, b), np.maximum(contacts.overlap, 0.0)
        tangential, rolling = (
            np.einsum("ci,ci->c", force, force) for force in (contacts.friction_force(), contacts.rolling_moment)
        )
        energy = links.on_arrays(self.normal.energy)
        if self.normal.energy is LinearSpring.energy:  # kn and kt in one quotient
            stored = energy(coefficient, overlap, tangential / self.tangential.share(scene))
        else:
            kt = self._shear_stiffness(scene, a, b, contacts.overlap)
            stored = energy(coefficient, overlap) + _quotient(0.5 * tangential, kt)
        if scene.twisting_friction > 0.0:
            twisting = np.einsum("ci,ci->c", contacts.rolling_moment, contacts.normal) ** 2
            rolling = rolling - twisting
            stored = stored + _quotient(0.5 * twisting, self.twisting_stiffness(scene, a, b, contacts.overlap))
        rolling = _quotient(0.5 * rolling, self.rolling_stiffness(scene, a, b, contacts.overlap))
        elastic = float(np.sum(stored + rolling))
        return elastic + links.energy(self, scene, a, b, contacts) if self.keeps_links else elastic

    def damping_ratio(self, scene: Scene) -> float:
        """Damping ratio of the stiffest mode of a specimen, which reduces the stable time step; 0 without dashpots."""
        return self.damping.ratio(scene) if self._dashpots(scene) else 0.0

    def features(self, scene: Scene) -> Features:
        """Numerical parameters of the parts for the scene, None for parts that the law lacks."""
        share = self.tangential.share(scene)
        friction = (scene.friction or None) if "tangential" in self.has else None
        rolling = self.rolling.numbers(scene, scene.rolling_friction) if self.rolls(scene) else None
        twisting = self.twisting.numbers(scene, scene.twisting_friction) if self.twists(scene) else None
        dashpots = self._dashpots(scene)
        whole = True if scene.limits == "forces" else None
        cohesion = self.cohesion.numbers(scene) if "cohesion" in self.has else None
        bond = self.bond.numbers(scene) if "bond" in self.has else None
        turning = True if any((friction, rolling, twisting, dashpots, bond)) else None
        return Features(share, friction, rolling, twisting, dashpots, whole, cohesion, bond, turning)

    def rolls(self, scene: Scene) -> bool:
        """True if the scene has rolling resistance."""
        return "rolling" in self.has and scene.rolling_friction > 0.0

    def twists(self, scene: Scene) -> bool:
        """True if the scene has twisting resistance."""
        return "twisting" in self.has and scene.twisting_friction > 0.0

    def local_damping(self, scene: Scene) -> float | None:
        """Coefficient of local damping of the scene, or None."""
        return self.damping.local(scene) if "damping" in self.has else None

    def _dashpots(self, scene: Scene) -> tuple[float, ...] | None:
        return self.damping.numbers(scene) if "damping" in self.has else None

    def yade(self, scene: Scene) -> YadeLaw | None:
        """The equivalent law in YADE, or None if YADE has none."""
        return None

    @property
    def unused(self) -> frozenset[str]:
        """Parameters of the scene that no part of the law uses.

        A user's own normal, tangential or damping part is assumed to use any parameter of such parts.
        """
        parts = [getattr(self, kind) for kind in DEFAULTS if kind in self.has or kind in ("normal", "tangential")]
        used = {name for part in parts for name in part.uses}
        if not all(is_labkits(type(part)) for part in parts):
            used |= OF_PARTS - {"rolling_friction", "twisting_friction", "limits"}
        return OF_PARTS - used

    @property
    def labkits(self) -> bool:
        """True if the law is part of labkit."""
        return is_labkits(type(self))

    @property
    def on_yade(self) -> bool:
        """True if the `yade` engine supports this law."""
        return type(self).yade is not ContactLaw.yade


DEFAULTS: dict[str, LawPart] = {
    "normal": LinearSpring(),
    "tangential": Coulomb(),
    "rolling": Rolling(),
    "twisting": Twisting(),
    "damping": Dashpots(),
    "cohesion": Adhesion(),
    "bond": ParallelBond(),
}


OF_PARTS = frozenset(
    name
    for part in (
        *(HertzSpring, Coulomb, Mindlin, RollingOfYade, TwistingOfYade, Dashpots, LocalDamping),
        *(Neck, Bridge, ParallelBond),
    )
    for name in part.uses
)


def _quotient(squared: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Energy of springs, J; 0 for those without stiffness."""
    return np.divide(squared, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0)
