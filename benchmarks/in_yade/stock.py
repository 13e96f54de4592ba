"""The same CV test as a plain YADE script, without labkit: the baseline of `./lab bench`.

    yade -n -x benchmarks/in_yade/stock.py grains.npz 500

grains.npz has radius, position, cell and time_step of a specimen. Grains are inserted in random order, settings are
YADE's defaults, and a PyRunner computes the stress. Prints the steps per second.
"""

import random
import sys
import time

import numpy as np

state = np.load(sys.argv[1])
steps = int(sys.argv[2])
radius, position = state["radius"].tolist(), state["position"].tolist()
order = list(range(len(radius)))
random.Random(1).shuffle(order)

O.periodic = True
O.cell.hSize = Matrix3(*state["cell"].ravel().tolist())
O.materials.append(
    CohFrictMat(
        young=pi / 2 * 0.15e9,
        poisson=0.5,
        density=2650,
        frictionAngle=atan(0.4),
        isCohesive=False,
        normalCohesion=0,
        shearCohesion=0,
        momentRotationLaw=True,
        alphaKr=0.25,
        alphaKtw=0,
        etaRoll=0.05,
        etaTwist=0,
    )
)
for k in order:
    O.bodies.append(sphere(position[k], radius[k]))
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom6D()],
        [Ip2_CohFrictMat_CohFrictMat_CohFrictPhys()],
        [Law2_ScGeom6D_CohFrictPhys_CohesionMoment(useIncrementalForm=True, always_use_moment_law=True)],
    ),
    PyRunner(command="getStress()", iterPeriod=100),
    NewtonIntegrator(damping=0.2),
]
O.dt = float(state["time_step"])
O.cell.velGrad = Matrix3(5, 0, 0, 0, 5, 0, 0, 0, -10)
O.run(max(1, steps // 5), True)
start = time.perf_counter()
O.run(steps, True)
print("steps_per_second", steps / (time.perf_counter() - start))
