"""Loads a script of `labkit export`; writes its stress, and YADE's own files: a save, a SpherePack, a table, VTK.

write_files.py OUTPUT.json SCRIPT FOLDER
"""

import json
import sys

import numpy as np
from yade import export, pack, utils

output, script, folder = sys.argv[1:4]
exec(open(script).read())  # it uses YADE's names
contacts = [contact for contact in O.interactions if contact.isReal]
result = {"stress": (-np.array(utils.getStress())).tolist(), "contacts": len(contacts)}
O.save(f"{folder}/saved.yade.gz")
spheres = pack.SpherePack()
spheres.fromSimulation()
spheres.save(f"{folder}/packed.txt")
export.text(f"{folder}/exported.txt")
vtk = export.VTKExporter(f"{folder}/vtk")
vtk.exportSpheres(what={"radius": "b.shape.radius"})
vtk.exportInteractions(
    what={
        "id1": "i.id1",
        "id2": "i.id2",
        "fn": "i.phys.normalForce.dot(i.geom.normal)",
        "shear_force": "i.phys.shearForce",
    }
)
with open(output, "w") as handle:
    json.dump(result, handle)
