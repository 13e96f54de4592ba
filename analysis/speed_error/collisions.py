"""Collisions of two grains on the `fused` engine, compared with closed forms: the error that a time step causes.

Two equal grains of mean diameter in a cell at rest, in the frame of their centre of mass; m* = m/2, w = sqrt(kn/m*).
They are in contact while delta >= 0.

Head on, with dashpots (law `spring_dashpot`):
delta'' + 2 beta w delta' + w^2 delta = 0 from delta = 0 to the next delta = 0, a time pi/w_d
later with w_d = w sqrt(1 - beta^2), so that

    e = exp(-pi beta/sqrt(1 - beta^2)).

The engine does the same: its dashpot acts as long as the grains overlap, and pulls just before they separate. (If the
contact ended when the force vanishes, at tan(w_d t) = -2 beta sqrt(1 - beta^2)/(1 - 2 beta^2), beta = 0.2 would give
0.572 instead of 0.527.)

Head on, with local damping lambda (law `rolling_resistance`):
the damping multiplies a force by 1 - lambda sign(F v), that is, by 1 + lambda until the grains come to rest and by
1 - lambda afterwards. In both phases the spring energy kn delta^2/2 at maximum overlap is the same:
m* v^2 = (1 + lambda) kn delta^2 and m* v'^2 = (1 - lambda) kn delta^2,

    e^2 = (1 - lambda)/(1 + lambda).

This holds only in the frame of the centre of mass: v in sign(F v) is the velocity of each grain, not the relative
velocity of the two.

Oblique, sliding throughout the contact: |ft| = mu kn delta always. The impulse of the spring equals that of the
whole normal force, because the impulse of the dashpot, 2 beta_n m* w times the change of delta, is zero. So

    Jt = mu (1 + e) m* vn      vt'/vt = 1 - 7/2 mu (1 + e) vn/vt,

where vt is the relative velocity of the two surfaces and 7/2 = 1 + 2 m* R^2/I. The grains slide throughout if
kt vt > mu kn vn at the start (the friction limit grows fastest then), that is vt > kappa mu vn, and vt' > kappa mu vn.
The tangential dashpot acts in addition to the friction limit and is left out.

As a function of the time step, measured over all phases (`collision_errors`): without dashpots every error is second
order, 0.2 % of the energy at 0.1 sqrt(m/kn). With dashpots it is first order, 2.4 % of e and 3.5 % of Jt at
0.1 sqrt(m/kn), because a dashpot acts during the whole of the step in which the contact begins or ends. Over a
collision it contributes an extra impulse of cn (vn + vn') dt/2, so the spring, which sets the friction limit,
contributes less: Jt is too low by beta_n w dt.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pandas

from labkit.engines import FusedEngine
from labkit.errors import InputError, PhysicsError
from labkit.grains import Scene, State, grains_in_cell

DURATION = math.pi / math.sqrt(2.0)  # duration of an undamped collision, sqrt(m/kn)
SAMPLES = 64  # phases within a step at which collisions begin and end
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
DEPTH = 1e-7  # v/(w R): with overlaps this small, the normal stays fixed and the lever arms equal R, to 3e-6
SLIP = 5.0  # vt/vn of the oblique collision; sliding needs more than kappa mu = 0.8
LONGEST = 6.0  # sqrt(m/kn): longer than any collision with lambda up to 0.9
STILL = np.zeros((3, 3))


@dataclasses.dataclass(frozen=True)
class Collision:
    """A scene, the slip vt/vn of its two grains, and the exact value of each quantity."""

    scene: Scene
    slip: float
    exact: dict[str, float]


def restitution(scene: Scene) -> float:
    """Coefficient of restitution e of a head-on pair in the frame of its centre of mass.

    It follows from the dashpots (law `spring_dashpot`) or from local damping (law `rolling_resistance`).
    """
    if scene.law == "spring_dashpot":
        return math.exp(-math.pi * scene.beta_n / math.sqrt(1.0 - scene.beta_n**2))
    return math.sqrt((1.0 - scene.local_damping) / (1.0 + scene.local_damping))


def tangential_impulse(scene: Scene) -> float:
    """Jt/(m* vn) of a pair that slides throughout the contact."""
    return scene.friction * (1.0 + restitution(scene))


def tangential_restitution(scene: Scene, slip: float) -> float:
    """vt'/vt of a pair that slides throughout the contact; slip: vt/vn."""
    return 1.0 - 3.5 * tangential_impulse(scene) / slip


def collisions() -> list[Collision]:
    """The collisions of the study, with the default material."""
    dashpots, rolling = Scene(law="spring_dashpot"), Scene(law="rolling_resistance")
    rigid = dataclasses.replace(rolling, local_damping=0.0)
    result = []
    for scene, undamped, oblique in (
        (dashpots, dataclasses.replace(dashpots, beta_n=0.0, beta_t=0.0), dataclasses.replace(dashpots, beta_t=0.0)),
        (rolling, rigid, rigid),
    ):
        impulse, rest = tangential_impulse(oblique), tangential_restitution(oblique, SLIP)
        result.append(Collision(scene, 0.0, {"restitution": restitution(scene)}))
        result.append(Collision(undamped, 0.0, {"energy kept without damping": 1.0}))
        result.append(Collision(oblique, SLIP, {"tangential impulse": impulse, "tangential restitution": rest}))
    return result


def approaching(scene: Scene, slip: float, time_step: float, offset: float) -> State:
    """State of two grains, one above the other, that touch `offset` steps after the first whole step."""
    radius = scene.mean_diameter / 2
    speed = DEPTH * radius * math.sqrt(2.0) / scene.time_unit
    gap = speed * time_step * (1.0 + offset)
    velocity = 0.5 * speed * np.array([[-slip, 0.0, 1.0], [slip, 0.0, -1.0]])
    position = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * radius + gap]])
    state = grains_in_cell(scene, np.full(2, radius), position, 10.0 * scene.mean_diameter * np.eye(3))
    return state.replace(velocity=velocity, time_step=time_step)


def surface_velocity(state: State) -> np.ndarray:
    """Velocity (3,) of the second grain's surface relative to the first's at their contact, m/s; the normal is z."""
    spin = state.radius @ state.angular_velocity
    return state.velocity[1] - state.velocity[0] - np.cross(spin, [0.0, 0.0, 1.0])


def outcome(before: State, after: State) -> dict[str, float]:
    """Quantities of a collision, name -> value, from the states before and after it.

    The tangential impulse is Jt/(m* vn), from the velocities of the centres; vt'/vt is that of the surfaces, NaN if
    the collision is head on.
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
    """Outcome of one collision at the time step `fraction` sqrt(m/kn). Raises PhysicsError if it does not end."""
    before = approaching(scene, slip, fraction * scene.time_unit, offset)
    engine = FusedEngine(before)
    engine.advance(3 + math.ceil(LONGEST / fraction), STILL)
    after = engine.state()
    if len(after.contact_grain):
        raise PhysicsError(f"two grains still touch with the time step {fraction:g} sqrt(m/kn): choose a smaller one")
    return outcome(before, after)


def phases() -> tuple[np.ndarray, np.ndarray]:
    """Phases of the start and end of a collision within a time step: two arrays (SAMPLES,).

    The first is the phase at which it begins, 0 to 1; the second is the fraction of a step by which its end is
    shifted, -1/2 to 1/2. Together they fill the square evenly (Fibonacci lattice).
    """
    sample = np.arange(SAMPLES)
    return (sample + 0.5) / SAMPLES, (sample * GOLDEN) % 1.0 - 0.5


def sampled_outcomes(collision: Collision, fraction: float) -> list[dict[str, float]]:
    """Outcomes of a collision at the time step `fraction` for all phases.

    To shift its end within a step, the time step is changed such that a collision lasts at most half a step longer.
    """
    return [
        collide(collision.scene, collision.slip, fraction / (1.0 + longer * fraction / DURATION), offset)
        for offset, longer in zip(*phases(), strict=True)
    ]


def collision_errors(time_step_fractions: Sequence[float]) -> pandas.DataFrame:
    """Measured and exact values, a pandas.DataFrame with a row per quantity, law and time step.

    time_step_fractions: in sqrt(m/kn) of the mean grain. Columns quantity, law, fraction, measured (mean over phases),
    exact, and error: the root mean square of measured/exact - 1 over the phases, because the phases within a step at
    which contacts begin and end are random in a specimen. Raises InputError for a fraction outside (0, 1).
    """
    for fraction in time_step_fractions:
        if not 0.0 < fraction < 1.0:
            raise InputError(f"a time step of {fraction:g} sqrt(m/kn) is not valid: use a value above 0 and below 1")
    rows = []
    for collision in collisions():
        for fraction in time_step_fractions:
            outcomes = sampled_outcomes(collision, fraction)
            for quantity, exact in collision.exact.items():
                measured = np.array([values[quantity] for values in outcomes])
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
