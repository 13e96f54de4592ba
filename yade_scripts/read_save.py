"""Reads a saved YADE simulation for `labkit import`, which starts this script.

yade -n -x yade_scripts/read_save.py SAVE OUTPUT.npz
"""

import sys

import numpy as np

STATED = ("density", "young", "poisson", "frictionAngle", "alphaKr", "alphaKtw", "etaRoll", "etaTwist")

save, output = sys.argv[1:3]
O.load(save)
spheres = [body for body in O.bodies if isinstance(body.shape, Sphere)]
contacts = [contact for contact in O.interactions if contact.isReal and hasattr(contact.phys, "normalForce")]
physics = [contact.phys for contact in contacts]
np.savez(
    output,
    id=np.array([body.id for body in spheres], dtype=int),
    position=np.array([tuple(body.state.pos) for body in spheres]),
    radius=np.array([body.shape.radius for body in spheres]),
    cell=np.array(O.cell.hSize, dtype=float).reshape(3, 3) if O.periodic else np.zeros(0),
    clump=np.array([body.clumpId if body.isClumpMember else -1 for body in spheres], dtype=int),
    others=sum(not isinstance(body.shape, Sphere) and not body.isClump for body in O.bodies),
    pairs=np.array([(contact.id1, contact.id2) for contact in contacts], dtype=int),
    overlap=np.array([getattr(contact.geom, "penetrationDepth", np.nan) for contact in contacts]),
    normal_force=np.array([contact.phys.normalForce.dot(contact.geom.normal) for contact in contacts]),
    materials=[
        " ".join(f"{name} {value:g}" for name, value in material.dict().items() if name in STATED)
        for material in O.materials
    ],
    shear_force=np.array([tuple(getattr(each, "shearForce", (0.0, 0.0, 0.0))) for each in physics]),
)
