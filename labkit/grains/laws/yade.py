"""The functors of YADE, as data, for the laws that it has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from labkit.grains.scene import Scene

LOADING_STEP = 1e-30  # s; the Hertz-Mindlin functor of YADE divides by the time step


class YadeClass(NamedTuple):
    """An object of YADE: the name of its class and its arguments, which may be such objects again."""

    name: str
    arguments: Mapping[str, float | str | YadeClass] = {}


class YadeLaw(NamedTuple):
    """A contact law in YADE, as data.

    material: function of a radius in m; geometry, physics, law: functors of an InteractionLoop; tangential_force,
    rolling_moment: names of the history variables in the interaction physics; losses: for friction, rolling and damping
    the name in YADE's energy tracker and those attributes of the law that are added to it, J; loading_step: time step
    in s of the two steps that find the contacts of a loaded state.
    """

    material: Callable[[float], YadeClass]
    geometry: YadeClass
    physics: YadeClass
    law: YadeClass
    tangential_force: str
    rolling_moment: str
    losses: tuple[tuple[str, tuple[str, ...]], ...]
    loading_step: float = 0.0


def cohesion_moment(scene: Scene) -> YadeLaw:
    """Law2_ScGeom6D_CohFrictPhys_CohesionMoment without cohesion; its incremental form needs no grain rotations."""
    return YadeLaw(
        lambda radius: material(scene, radius),
        YadeClass("Ig2_Sphere_Sphere_ScGeom6D", {"updateRotations": False}),
        YadeClass("Ip2_CohFrictMat_CohFrictMat_CohFrictPhys"),
        YadeClass(
            "Law2_ScGeom6D_CohFrictPhys_CohesionMoment", {"useIncrementalForm": True, "always_use_moment_law": True}
        ),
        "shearForce",
        "moment_bending",
        (("shearDissip", ()), ("bendingDissip", ()), ("nonviscDamp", ())),
    )


def material(scene: Scene, radius: float) -> YadeClass:
    """YADE's material for a grain of the scene, without cohesion and twisting moments.

    YADE's kn is 2 Ea Ra Eb Rb/(Ea Ra + Eb Rb): setting `young` = kn/R for two equal grains reproduces the kn of the
    scene. For spheres this is (pi/2) E for any radius. Negative cohesion or moment limits, YADE's defaults, would mean
    no limit.
    """
    alpha, eta = scene.contact_law.rolling.numbers(scene, scene.rolling_friction)
    return YadeClass(
        "CohFrictMat",
        {
            "young": float(scene.normal_stiffness(radius, radius)) / radius,
            "poisson": 1.0 / scene.stiffness_ratio,  # gives kt = kn/kappa exactly
            "density": scene.density,
            "frictionAngle": float(np.arctan(scene.friction)),
            "isCohesive": False,
            "normalCohesion": 0.0,
            "shearCohesion": 0.0,
            "fragile": True,
            "momentRotationLaw": scene.rolling_friction > 0.0,
            "alphaKr": alpha,
            "etaRoll": eta,
            "alphaKtw": 0.0,
            "etaTwist": 0.0,
        },
    )


def mindlin(scene: Scene) -> YadeLaw:
    """Law2_ScGeom_MindlinPhys_Mindlin without adhesion and moments."""
    material = YadeClass(
        "FrictMat",
        {
            "young": scene.young_modulus,
            "poisson": scene.poisson_ratio,
            "density": scene.density,
            "frictionAngle": float(np.arctan(scene.friction)),
        },
    )
    beta = {} if scene.contact_law.features(scene).dashpots is None else {"betan": scene.beta_n, "betas": scene.beta_t}
    return YadeLaw(
        lambda radius: material,
        YadeClass("Ig2_Sphere_Sphere_ScGeom", {"avoidGranularRatcheting": False}),
        YadeClass(
            "Ip2_FrictMat_FrictMat_MindlinPhys",
            {name: YadeClass("MatchMaker", {"algo": "val", "val": value}) for name, value in beta.items()},
        ),
        YadeClass("Law2_ScGeom_MindlinPhys_Mindlin", {"calcEnergy": True}),
        "shearElastic",
        "momentBend",
        (("", ("frictionDissipation",)), ("", ()), ("nonviscDamp", ("normDampDissip", "shearDampDissip"))),
        loading_step=LOADING_STEP,
    )
