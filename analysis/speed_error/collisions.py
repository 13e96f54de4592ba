"""Collisions of two grains on the engine fused against closed forms: what a time step costs where the answer is known.

Equal grains of mean diameter in a cell that stands still, seen from their centre of mass, m* = m/2, w = sqrt(kn/m*).
They touch while delta >= 0.

Head on, dashpots (law spring_dashpot):
delta'' + 2 beta w delta' + w^2 delta = 0 from delta = 0 to the next delta = 0, pi/w_d
later with w_d = w sqrt(1 - beta^2), so that

    e = exp(-pi beta/sqrt(1 - beta^2)).

The engine is that: its dashpot acts as long as grains overlap and pulls before they part. (If contact ended with the
force, at tan(w_d t) = -2 beta sqrt(1 - beta^2)/(1 - 2 beta^2), beta = 0.2 would give 0.572 for 0.527.)

Head on, Newton's local damping lambda (law rolling_resistance):
a force is multiplied by 1 - lambda sign(F v), so by 1 + lambda
until the grains stand and by 1 - lambda afterwards. Both times the spring's energy kn delta^2/2 is that of the
deepest point: m* v^2 = (1 + lambda) kn delta^2 and m* v'^2 = (1 - lambda) kn delta^2,

    e^2 = (1 - lambda)/(1 + lambda).

This holds in the frame of the centre of mass alone: v in sign(F v) is that of each grain, not of the two to each other.

Oblique, sliding from the first to the last instant: |ft| = mu kn delta always. The spring's impulse is that of the
whole normal force, because the dashpot's, 2 beta_n m* w times the change of delta, is zero. So

    Jt = mu (1 + e) m* vn      vt'/vt = 1 - 7/2 mu (1 + e) vn/vt,

vt the velocity of the two surfaces to each other; 7/2 = 1 + 2 m* R^2/I. They slide all the time if kt vt > mu kn vn
at the start (the limit grows fastest then), that is vt > kappa mu vn, and vt' > kappa mu vn. The tangential dashpot
acts beside the limit and is left out.

In the time step, measured over all phases (`collision_errors`): without dashpots every error is of second order,
0.2 % of the energy at 0.1 sqrt(m/kn). With them it is of first order, 2.4 % of e and 3.5 % of Jt at 0.1 sqrt(m/kn),
because a dashpot acts for the whole of the step in which contact begins or ends. Over a collision it then pushes, by
cn (vn + vn') dt/2, and the spring, which bounds friction, has less to do: Jt is low by beta_n w dt.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Hashable, Sequence

import numpy as np
import pandas

from labkit.dem import Scene, State, grains_in_cell
from labkit.engines import FusedEngine
from labkit.errors import InputError, PhysicsError

DURATION = math.pi / math.sqrt(2.0)  # of a collision without damping, in sqrt(m/kn)
SAMPLES = 64  # of the places of begin and end of a collision within a step
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
DEPTH = 1e-7  # v/(w R): overlaps so small that the normal does not turn and arms are R, to 3e-6
SLIP = 5.0  # vt/vn of the oblique collision; kappa mu = 0.8
LONGEST = 6.0  # sqrt(m/kn): more than a collision lasts up to lambda = 0.9
STILL = np.zeros((3, 3))


@dataclasses.dataclass(frozen=True)
class Collision:
    """A scene, the slip vt/vn of its two grains, and the exact values: quantity -> number."""

    scene: Scene
    slip: float
    exact: dict[str, float]


def restitution(scene: Scene) -> float:
    """e of a head-on pair in its centre of mass: of the dashpots (law spring_dashpot) or of local damping (law
    rolling_resistance).
    """
    if scene.law == "spring_dashpot":
        return math.exp(-math.pi * scene.beta_n / math.sqrt(1.0 - scene.beta_n**2))
    return math.sqrt((1.0 - scene.local_damping) / (1.0 + scene.local_damping))


def tangential_impulse(scene: Scene) -> float:
    """Jt/(m* vn) of a pair that slides all the time."""
    return scene.friction * (1.0 + restitution(scene))


def tangential_restitution(scene: Scene, slip: float) -> float:
    """vt'/vt of a pair that slides all the time; slip: vt/vn."""
    return 1.0 - 3.5 * tangential_impulse(scene) / slip


def collisions() -> list[Collision]:
    """The Collisions of the study, with the default material."""
    undamped = {"local_damping": 0.0}
    free = {"spring_dashpot": {"beta_n": 0.0, "beta_t": 0.0}, "rolling_resistance": undamped}
    oblique = {"spring_dashpot": {"beta_t": 0.0}, "rolling_resistance": undamped}
    found = []
    for law in ("spring_dashpot", "rolling_resistance"):
        scene = Scene(law=law)
        found.append(Collision(scene, 0.0, {"restitution": restitution(scene)}))
        scene = Scene(law=law, **free[law])
        found.append(Collision(scene, 0.0, {"energy kept without damping": 1.0}))
        scene = Scene(law=law, **oblique[law])
        exact = {
            "tangential impulse": tangential_impulse(scene),
            "tangential restitution": tangential_restitution(scene, SLIP),
        }
        found.append(Collision(scene, SLIP, exact))
    return found


def approaching(scene: Scene, slip: float, time_step: float, offset: float) -> State:
    """Two grains, one above the other, that touch `offset` steps after the first whole step; a State."""
    radius = scene.mean_diameter / 2
    speed = DEPTH * radius * math.sqrt(2.0) / scene.time_unit
    gap = speed * time_step * (1.0 + offset)
    velocity = 0.5 * speed * np.array([[-slip, 0.0, 1.0], [slip, 0.0, -1.0]])
    position = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * radius + gap]])
    state = grains_in_cell(scene, np.full(2, radius), position, 10.0 * scene.mean_diameter * np.eye(3))
    return state.replace(velocity=velocity, time_step=time_step)


def surface_velocity(state: State) -> np.ndarray:
    """Velocity (3,) of the second grain's surface to the first's at their point of contact, m/s; the normal is z."""
    spin = state.radius @ state.angular_velocity
    return state.velocity[1] - state.velocity[0] - np.cross(spin, [0.0, 0.0, 1.0])


def outcome(before: State, after: State) -> dict[str, float]:
    """What a collision has done: quantity -> number, from the States before and after.

    The tangential impulse is Jt/(m* vn), from the velocities of the centres; vt'/vt is of the surfaces, NaN head on.
    """
    v, w = surface_velocity(before), surface_velocity(after)
    energy = [
        state.scene.mass(state.radius) @ (state.velocity**2).sum(axis=1)
        + state.scene.moment_of_inertia(state.radius) @ (state.angular_velocity**2).sum(axis=1)
        for state in (before, after)
    ]
    centres = [state.velocity[1, 0] - state.velocity[0, 0] for state in (before, after)]
    return {
        "restitution": -w[2] / v[2],
        "energy kept without damping": energy[1] / energy[0],
        "tangential impulse": (centres[1] - centres[0]) / v[2],
        "tangential restitution": w[0] / v[0] if v[0] else math.nan,
    }


def collide(scene: Scene, slip: float, fraction: float, offset: float) -> dict[str, float]:
    """The outcome of one collision at the time step `fraction` sqrt(m/kn). Raises PhysicsError if it does not end."""
    before = approaching(scene, slip, fraction * scene.time_unit, offset)
    engine = FusedEngine(before)
    engine.advance(3 + math.ceil(LONGEST / fraction), STILL)
    after = engine.state()
    if len(after.contact_grain):
        raise PhysicsError(f"two grains still touch at the time step {fraction:g} sqrt(m/kn): give a smaller one")
    return outcome(before, after)


def phases() -> tuple[np.ndarray, np.ndarray]:
    """Where within a step a collision begins, from 0 to 1, and by how much of a step longer it lasts than the given
    time step has it, -1/2 to 1/2: arrays (SAMPLES,) that fill the square evenly (Fibonacci's lattice).
    """
    sample = np.arange(SAMPLES)
    return (sample + 0.5) / SAMPLES, (sample * GOLDEN) % 1.0 - 0.5


def sampled_outcomes(collision: Collision, fraction: float) -> list[dict[str, float]]:
    """Outcomes of a Collision at the time step `fraction` for all phases, a list of quantity -> number.

    The time step is changed by less than half a step in a collision, to move its end within a step.
    """
    return [
        collide(collision.scene, collision.slip, fraction / (1.0 + longer * fraction / DURATION), offset)
        for offset, longer in zip(*phases(), strict=True)
    ]


def collision_errors(time_step_fractions: Sequence[float]) -> pandas.DataFrame:
    """Measured against exact, a pandas.DataFrame with a row per quantity, law and time step.

    time_step_fractions: of sqrt(m/kn) of the mean grain. Columns quantity, law, fraction, measured (mean over phases),
    exact, and error: the root of the mean square of measured/exact - 1 over phases, because the moments within a step
    at which a contact begins and ends are chance in a specimen. Raises InputError for a fraction that resolves no
    collision.
    """
    for fraction in time_step_fractions:
        if not 0.0 < fraction < 1.0:
            raise InputError(f"a time step of {fraction:g} sqrt(m/kn) is not possible: give above 0 and below 1")
    rows = []
    for collision in collisions():
        for fraction in time_step_fractions:
            found = sampled_outcomes(collision, fraction)
            for quantity, exact in collision.exact.items():
                measured = np.array([one[quantity] for one in found])
                rows.append(
                    {
                        "quantity": quantity,
                        "law": collision.scene.law,
                        "fraction": fraction,
                        "measured": measured.mean(),
                        "exact": exact,
                        "error": float(np.sqrt(np.mean((measured / exact - 1.0) ** 2))),
                    }
                )
    return pandas.DataFrame(rows)


def orders(errors: pandas.DataFrame) -> dict[Hashable, float]:
    """Order of convergence in the time step, the slope of log error over log fraction; (quantity, law) -> number."""
    return {
        key: float(np.polyfit(np.log(rows["fraction"]), np.log(rows["error"]), 1)[0])
        for key, rows in errors.groupby(["quantity", "law"])
    }
