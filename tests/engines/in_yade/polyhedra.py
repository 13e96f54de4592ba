"""Polyhedra fall into a box in YADE, which writes their volumes and contacts, and the stress of their forces.

polyhedra.py FOLDER
"""

import csv
import json
import math
import sys
from pathlib import Path

import numpy as np
from yade import polyhedra_utils, utils

folder, side = Path(sys.argv[1]), 0.3
material = PolyhedraMat(density=2600, young=1e7, poisson=0.3, frictionAngle=0.5)
polyhedra_utils.fillBox((0, 0, 0), (side, side, side), material, [0.06] * 3, [0.1] * 3, seed=4)
grains = list(O.bodies)
O.bodies.append([utils.wall(place, axis=axis, material=material) for axis in range(3) for place in (0.0, side)])
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Polyhedra_Aabb(), Bo1_Wall_Aabb()], verletDist=0.01),
    InteractionLoop(
        [Ig2_Wall_Polyhedra_PolyhedraGeom(), Ig2_Polyhedra_Polyhedra_PolyhedraGeom()],
        [Ip2_PolyhedraMat_PolyhedraMat_PolyhedraPhys()],
        [Law2_PolyhedraGeom_PolyhedraPhys_Volumetric()],
    ),
    NewtonIntegrator(damping=0.3, gravity=(0, 0, -9.81)),
]
O.dt = 5e-4
O.run(1500, True)

sizes = [(3.0 * grain.shape.GetVolume() / (4.0 * math.pi)) ** (1.0 / 3.0) for grain in grains]
with (folder / "grains.csv").open("w") as file:
    rows = csv.writer(file)
    rows.writerow(["id", "x [m]", "y [m]", "z [m]", "radius [m]"])
    rows.writerows([grain.id, *map(float, grain.state.pos), size] for grain, size in zip(grains, sizes, strict=True))
stress, carrying = np.zeros((3, 3)), 0
vectors = ("contact_point", "normalForce", "shearForce")
with (folder / "contacts.csv").open("w") as file:
    rows = csv.writer(file)
    rows.writerow(["id1", "id2", *(f"{name}_{axis}" for name in vectors for axis in "xyz")])
    for contact in O.interactions:
        if contact.isReal and max(contact.id1, contact.id2) < len(grains):
            normal, shear = contact.phys.normalForce, contact.phys.shearForce
            rows.writerow([contact.id1, contact.id2, *map(float, [*contact.geom.contactPoint, *normal, *shear])])
            branch = O.bodies[contact.id2].state.pos - O.bodies[contact.id1].state.pos
            stress += np.outer(branch, normal + shear) / side**3
            carrying += normal.norm() > 0.0
solid = sum(grain.shape.GetVolume() for grain in grains)
result = {"stress": stress.tolist(), "contacts": carrying, "e": side**3 / solid - 1.0, "side": side}
(folder / "result.json").write_text(json.dumps(result))
