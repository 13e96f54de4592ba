"""Scenes on YADE that need walls or gravity: a box of rigid walls, and grains that fall onto a floor.

yade -n -x -j1 scenes.py INPUT.json OUTPUT.npz

INPUT: scene (walls or deposit), seed, material, wall_material, physics, law (YADE's classes with their arguments),
time_step, damping, diameter, spread, and the other arguments of the scene's function. SI units, stress positive in
compression. The cycle starts with the motion, so that positions, walls and forces after a step belong to one instant.
"""

import json
import sys
from typing import Any

import numpy as np
from yade import Vector3, utils, wrapper

Arguments = dict[str, Any]
Arrays = dict[str, Any]

omega = wrapper.Omega()
SPACING = 1.22  # spacing of the gas, in mean diameters
AXES = range(3)


def build(call: list[Any]) -> Any:
    """Build the YADE object of a pair [class name, {argument: value}]."""
    name, arguments = call
    return getattr(wrapper, name)(**arguments)


def add_gas(given: Arguments, rng: np.random.Generator, counts: list[int], floor: float, speed: float) -> None:
    """Add grains on a lattice of `counts` (3,) points that begins at the height `floor`, m, with random velocities."""
    points = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    points = (points + 0.5) * SPACING * given["diameter"] + (0.0, 0.0, floor)
    material = build(given["material"])
    for point, size, velocity in zip(
        points, rng.uniform(-1.0, 1.0, len(points)), rng.normal(0.0, speed, points.shape), strict=True
    ):
        radius = 0.5 * given["diameter"] * (1.0 + given["spread"] * size)
        grain = utils.sphere(Vector3(*point), radius, material=material)
        grain.state.vel = Vector3(*velocity)
        omega.bodies.append(grain)


def start(given: Arguments, **newton: Any) -> None:
    """Set the engines and the time step."""
    boxes = [wrapper.Bo1_Sphere_Aabb(), wrapper.Bo1_Box_Aabb()]
    geometry = [wrapper.Ig2_Sphere_Sphere_ScGeom6D(updateRotations=False), wrapper.Ig2_Box_Sphere_ScGeom6D()]
    omega.dt = given["time_step"]
    omega.engines = [
        wrapper.NewtonIntegrator(damping=given["damping"], warnNoForceReset=False, **newton),
        wrapper.ForceResetter(),
        wrapper.InsertionSortCollider(boxes, verletDist=-0.1),
        wrapper.InteractionLoop(geometry, [build(given["physics"])], [build(given["law"])]),
    ]


def grains_and_contacts() -> Arrays:
    """Return the arrays of this instant; the grains come first among the bodies, and forces act on the second body."""
    grains = [body for body in omega.bodies if isinstance(body.shape, wrapper.Sphere)]
    real = [contact for contact in omega.interactions if contact.isReal]
    rows = {
        "pair": [(c.id1, c.id2) for c in real],
        "shift": [tuple(c.cellDist) for c in real],
        "normal": [tuple(c.geom.normal) for c in real],
        "overlap": [c.geom.penetrationDepth for c in real],
        "normal_force": [tuple(c.phys.normalForce) for c in real],
        "tangential_force": [tuple(c.phys.shearForce) for c in real],
        "rolling_moment": [tuple(c.phys.moment_bending) for c in real],
        "radius": [grain.shape.radius for grain in grains],
        "position": [tuple(grain.state.pos) for grain in grains],
        "velocity": [tuple(grain.state.vel) for grain in grains],
        "force": [tuple(omega.forces.f(grain.id, True)) for grain in grains],
    }
    return {name: np.array(values) for name, values in rows.items()}


class Box:
    """Six rigid walls about the grains."""

    def __init__(self, given: Arguments, size: list[float]) -> None:
        """Build walls about a cuboid from the origin with this size (3,), m."""
        thick, material = given["diameter"], build(given["wall_material"])
        self.walls = []  # for each axis, the lower and the upper wall
        for axis in AXES:
            for face in (0.0, size[axis]):
                centre = 0.5 * np.array(size)
                centre[axis] = face + (thick if face else -thick)
                extents = np.where(np.arange(3) == axis, thick, 2.0 * np.array(size))
                wall = utils.box(Vector3(*centre), Vector3(*extents), fixed=True, material=material)
                self.walls.append(omega.bodies[omega.bodies.append(wall)])
        self.thick = thick

    def faces(self) -> np.ndarray:
        """Return the coordinates of the lower and upper faces, (3, 2), m."""
        centres = np.array([wall.state.pos[k // 2] for k, wall in enumerate(self.walls)]).reshape(3, 2)
        return centres + self.thick * np.array([1.0, -1.0])

    def forces(self) -> np.ndarray:
        """Return the forces of the grains on the walls, (axis, lower and upper, 3), N."""
        return np.array([tuple(omega.forces.f(wall.id, True)) for wall in self.walls]).reshape(3, 2, 3)

    def stress(self) -> np.ndarray:
        """Return the normal stresses, means of opposite walls, (3,), Pa."""
        faces, forces = self.faces(), self.forces()
        size = faces[:, 1] - faces[:, 0]
        along = np.array([0.5 * (forces[axis, 1, axis] - forces[axis, 0, axis]) for axis in AXES])
        return along * size / size.prod()

    def move(self, rates: np.ndarray) -> None:
        """Let the walls approach with these strain rates (3,), compression positive."""
        faces = self.faces()
        for axis in AXES:
            speed = 0.5 * rates[axis] * (faces[axis, 1] - faces[axis, 0])
            for side, sign in enumerate((1.0, -1.0)):
                self.walls[2 * axis + side].state.vel = Vector3(*(sign * speed * np.eye(3)[axis]))


def walls(given: Arguments, rng: np.random.Generator) -> Arrays:
    """Compress a gas to the isotropic `pressure`, let it rest, and shear it along z with the lateral stress held.

    One instant at rest, then one after each share of the axial `strain`.
    """
    pressure, most, interval = given["pressure"], given["servo_rate"], 20
    counts = given["counts"]
    add_gas(given, rng, counts, 0.0, 0.1)
    box = Box(given, [SPACING * given["diameter"] * count for count in counts])
    start(given)

    def instant(strain: float) -> Arrays:
        return {"strain": strain, "faces": box.faces(), "wall_force": box.forces(), **grains_and_contacts()}

    for _ in range(given["most_steps"] // interval):
        omega.run(interval, True)
        off = 1.0 - box.stress() / pressure
        box.move(most * np.clip(off, -1.0, 1.0))
        if np.abs(off).max() < 2e-3 and utils.unbalancedForce() < 2e-3:
            break
    box.move(np.zeros(3))
    for _ in range(40):
        omega.run(1000, True)
        if utils.unbalancedForce() < 1e-4:
            break
    found, strain = [instant(0.0)], 0.0
    for number in range(1, given["instants"] + 1):
        while strain < given["strain"] * number / given["instants"]:
            rates = most * np.clip(1.0 - box.stress() / pressure, -1.0, 1.0)
            rates[2] = given["rate"]
            box.move(rates)
            omega.run(interval, True)
            strain += given["rate"] * interval * omega.dt
        found.append(instant(strain))
    return {f"{name}_{k}": values for k, one in enumerate(found) for name, values in one.items()}


def deposit(given: Arguments, rng: np.random.Generator) -> Arrays:
    """Let a gas fall under `gravity` onto a floor of fixed grains, in a cell periodic in x and y, until it rests."""
    counts, diameter = given["counts"], given["diameter"]
    width, height = SPACING * diameter * counts[0], SPACING * diameter * (counts[2] + 4)
    omega.periodic = True
    omega.cell.setBox(width, width, height)
    add_gas(given, rng, [counts[0], counts[0], 1], diameter * (0.5 - 0.5 * SPACING), 0.0)
    floor = len(omega.bodies)
    for body in omega.bodies:
        body.state.pos += Vector3(0.0, 0.0, rng.uniform(0.0, 0.3 * diameter))
        body.state.vel, body.dynamic = Vector3.Zero, False
    add_gas(given, rng, counts, 1.5 * diameter, given["speed"])
    start(given, gravity=Vector3(0.0, 0.0, -given["gravity"]))
    steps = 0
    while steps < given["most_steps"]:
        omega.run(2000, True)
        steps += 2000
        if steps > given["least_steps"] and utils.unbalancedForce() < given["unbalanced"]:
            break
    unbalanced = utils.unbalancedForce()
    return {
        "floor": floor,
        "cell": [width, width, height],
        "steps": steps,
        "unbalanced": unbalanced,
    } | grains_and_contacts()


with open(sys.argv[1]) as file:
    arguments = json.load(file)
scene = {"walls": walls, "deposit": deposit}[arguments["scene"]]
np.savez_compressed(sys.argv[2], **scene(arguments, np.random.default_rng(arguments["seed"])))
