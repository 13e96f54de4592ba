"""Contact laws in YADE, as data for the server that runs in YADE; each part supplies arguments of YADE's functors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from labkit.grains.laws.kinematics import FirstOrder, Kinematics, WithoutRatcheting

if TYPE_CHECKING:
    from labkit.grains.laws.law import ContactLaw
    from labkit.grains.scene import Scene


class YadeClass(NamedTuple):
    """A YADE object: the name of its class and its arguments, some of which may themselves be YADE objects."""

    name: str
    arguments: Mapping[str, object] = {}

    def with_arguments(self, arguments: Iterable[Mapping[str, object]]) -> YadeClass:
        """Return the object with further arguments."""
        pairs = (pair for some in (self.arguments, *arguments) for pair in some.items())
        return YadeClass(self.name, dict(pairs))


class YadeFunctors(NamedTuple):
    """The functors of a contact in YADE, and the energies that they dissipate.

    Args:
        kinematics: How a contact moves in a time step.
        material: Material.
        geometry: Geometry functor of an InteractionLoop.
        physics: Physics functor.
        law: Law functor.
        losses: For friction, rolling and damping: the name of the energy in YADE's energy tracker, and the attributes
            of the law functor that are added to it (J).
        loading_step: Time step (s) of the two steps that find the contacts of a loaded state.
    """

    kinematics: Kinematics
    material: YadeClass
    geometry: YadeClass
    physics: YadeClass
    law: YadeClass
    losses: tuple[tuple[str, tuple[str, ...]], ...]
    loading_step: float = 0.0


class InYade(NamedTuple):
    """A part in YADE.

    Args:
        functors: Functors of the contact; None for a part that does not act on contacts, such as local damping.
        material: Further arguments of the material.
        physics: Further arguments of the physics functor.
        history: Name of a column of history, an odd vector -> its name in the interaction physics.
    """

    functors: YadeFunctors | None
    material: Mapping[str, object] = {}
    physics: Mapping[str, object] = {}
    history: Mapping[str, str] = {}


class YadeLaw(NamedTuple):
    """A contact law in YADE: the material of grains of a radius (m), functors with all arguments, and history."""

    material: Callable[[float], YadeClass]
    functors: YadeFunctors
    history: Mapping[str, str]


COHESION_MOMENT = YadeFunctors(  # no cohesion; the incremental form needs no grain rotations
    WithoutRatcheting,
    YadeClass(
        "CohFrictMat",  # the default cohesion and moment limits are negative, which means unlimited
        {
            "isCohesive": False,
            "normalCohesion": 0.0,
            "shearCohesion": 0.0,
            "fragile": True,
            "momentRotationLaw": False,
            "alphaKr": 0.0,
            "etaRoll": 0.0,
            "alphaKtw": 0.0,
            "etaTwist": 0.0,
        },
    ),
    YadeClass("Ig2_Sphere_Sphere_ScGeom6D", {"updateRotations": False}),
    YadeClass("Ip2_CohFrictMat_CohFrictMat_CohFrictPhys"),
    YadeClass("Law2_ScGeom6D_CohFrictPhys_CohesionMoment", {"useIncrementalForm": True, "always_use_moment_law": True}),
    (("shearDissip", ()), ("bendingDissip", ()), ("nonviscDamp", ())),
)
MINDLIN = YadeFunctors(  # no rolling or twisting moments
    FirstOrder,
    YadeClass("FrictMat"),
    YadeClass("Ig2_Sphere_Sphere_ScGeom", {"avoidGranularRatcheting": False}),
    YadeClass("Ip2_FrictMat_FrictMat_MindlinPhys"),
    YadeClass("Law2_ScGeom_MindlinPhys_Mindlin", {"calcEnergy": True}),
    (("", ("frictionDissipation",)), ("", ()), ("nonviscDamp", ("normDampDissip", "shearDampDissip"))),
    loading_step=1e-30,  # the functor divides by the time step
)


def compose_yade(law: ContactLaw, scene: Scene) -> YadeLaw | None:
    """Return a law in YADE, or None if YADE does not have this law.

    YADE has a law if it has all parts of the law, in the same functors and with the same kinematics. A subclass of a
    part that YADE has is treated as a different part, unless the subclass itself defines `yade`.
    """
    parts = law.parts_by_kind.values()
    if not {"normal", "tangential"} <= law.has or any("yade" not in vars(type(part)) for part in parts):
        return None

    def parts_in_yade(radius: float) -> list[InYade]:
        each = (part.yade(scene, radius) for part in parts)
        return [part for part in each if part is not None]

    mean = parts_in_yade(0.5 * scene.mean_diameter)
    first, *others = (part.functors for part in mean if part.functors is not None)
    if len(mean) < len(parts) or law.kinematics is not first.kinematics or any(part is not first for part in others):
        return None
    physics = first.physics.with_arguments(part.physics for part in mean)
    density = {"density": scene.density}
    return YadeLaw(
        lambda radius: first.material.with_arguments([density, *(part.material for part in parts_in_yade(radius))]),
        first._replace(physics=physics),
        {column: name for part in mean for column, name in part.history.items()},
    )
