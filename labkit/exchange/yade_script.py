"""A YADE script that loads a State into a stock YADE, without labkit: grains, cell, contact history, material, law."""

from __future__ import annotations

import json
import math
from pathlib import Path

from labkit.dem.state import State
from labkit.errors import InputError
from labkit.exchange.formats import Format
from labkit.io.atomic import write_text

TEMPLATE = '''"""Grains of a labkit state for a stock YADE: `yade {name}`. Written by labkit; units m, kg, s.

The first step, with a time step of zero, finds the contacts; their shear forces and bending moments are then set.
"""

from yade import utils

RADIUS = {radius}
POSITION = {position}
VELOCITY = {velocity}
SPIN = {spin}
PAIRS = {pairs}
SHEAR_FORCE = {shear}  # on the second grain, as in YADE
BENDING_MOMENT = {moment}

O.periodic = True
O.cell.setBox(1, 1, 1)
O.cell.hSize = Matrix3({cell})
material = O.materials.append(CohFrictMat(
    young={young!r}, poisson={poisson!r}, density={density!r}, frictionAngle={angle!r}, isCohesive=False,
    normalCohesion=0, shearCohesion=0, fragile=True, momentRotationLaw={rolls!r}, alphaKr=0.25, etaRoll={eta!r},
    alphaKtw=0, etaTwist=0))
for radius, position, velocity, spin in zip(RADIUS, POSITION, VELOCITY, SPIN):
    grain = utils.sphere(position, radius, material=material)
    grain.state.vel, grain.state.angVel = velocity, spin
    O.bodies.append(grain)
newton = NewtonIntegrator(damping={damping!r})
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()]),
    InteractionLoop([Ig2_Sphere_Sphere_ScGeom6D(updateRotations=False)], [Ip2_CohFrictMat_CohFrictMat_CohFrictPhys()],
                    [Law2_ScGeom6D_CohFrictPhys_CohesionMoment(useIncrementalForm=True, always_use_moment_law=True)]),
    newton,
]
newton.dead, O.dt = True, 0.0
O.step()
history = dict(zip(PAIRS, zip(SHEAR_FORCE, BENDING_MOMENT)))
for contact in O.interactions:
    pair, sign = (contact.id1, contact.id2), 1.0
    if pair not in history:
        pair, sign = (contact.id2, contact.id1), -1.0
    if pair in history:
        contact.phys.shearForce = sign * Vector3(history[pair][0])
        contact.phys.moment_bending = sign * Vector3(history[pair][1])
newton.dead, O.dt = False, {time_step!r}
'''


class YadeScript(Format):
    """A self-contained Python script for YADE, for states with the rolling-resistance law of YADE."""

    name = "yade_script"
    description = "script that loads the grains and contacts into a stock YADE"
    endings = (".py",)

    def recognises(self, file: Path, head: str) -> bool:
        return False  # written, not read

    def write(self, state: State, file: Path) -> None:
        """Writes grains, cell, contacts, material and engines. Raises InputError for another contact law.

        YADE's kn is 2 Ea Ra Eb Rb/(Ea Ra + Eb Rb), that of labkit pi E Ra Rb/(Ra + Rb): `young` is (pi/2) E, and
        kt/kn is `poisson` (labkit.dem.laws.rolling_resistance.material).
        """
        scene = state.scene
        if scene.law != "rolling_resistance" or scene.planar:
            raise InputError(f"{file}: the script has only the rolling_resistance law of spheres, not {scene.law}")
        text = TEMPLATE.format(
            name=file.name,
            radius=json.dumps(state.radius.tolist()),
            position=json.dumps(state.position.tolist()),
            velocity=json.dumps(state.velocity.tolist()),
            spin=json.dumps(state.angular_velocity.tolist()),
            pairs=[tuple(pair) for pair in state.contact_grain.tolist()],
            shear=json.dumps((-state.tangential_force).tolist()),
            moment=json.dumps((-state.rolling_moment).tolist()),
            cell=", ".join(map(repr, state.cell.ravel().tolist())),
            young=0.5 * math.pi * scene.young_modulus,
            poisson=1.0 / scene.stiffness_ratio,
            density=scene.density,
            angle=math.atan(scene.friction),
            rolls=scene.rolling_friction > 0.0,
            eta=0.5 * scene.rolling_limit_scale * scene.rolling_friction,
            damping=scene.local_damping,
            time_step=state.time_step or scene.time_step,
        )
        write_text(file, text)
