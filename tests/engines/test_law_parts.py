"""The parts of contact laws: energy and force, closed forms, compiled and plain Python, and parts that are refused."""

from types import MappingProxyType

import numba
import numpy as np
import pytest

import labkit as lk
from labkit.engines.fused import FusedEngine
from labkit.engines.kernel.sources import try_out
from labkit.engines.kernel.translate import Translation
from labkit.errors import InputError
from labkit.files.schema import HISTORY, LOSSES
from labkit.grains.laws import LAWS, Contact
from labkit.grains.laws.parts import PARAMETERS
from labkit.grains.laws.vectors import ZERO, Vector, dot, opposite
from labkit.grains.registration import require_potential
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def declarations():
    """What the parts of a test declare, for that test."""
    before = [set(known) for known in (HISTORY, LOSSES, PARAMETERS)]
    yield
    for known, names in zip((HISTORY, LOSSES, PARAMETERS), before, strict=True):
        for name in known.keys() - names:
            del known[name]


A, B = 9e-5, 8e-5  # radii, m
REDUCED = A * B / (A + B)
TWISTED = {"twisting_friction": 0.15}
SCENES = {
    **{law: Scene(law=law) for law in LAWS if not LAWS[law]().far},  # for the others see test_reach.py
    "rolling_resistance twisting": Scene(**TWISTED),
    "twisting alone": Scene(law="spring_dashpot", rolling_friction=0.0, **TWISTED),
    "spring_dashpot twisting": Scene(law="spring_dashpot", **TWISTED),
    "whole forces": Scene(law="spring_dashpot", limits="forces"),
    "hertz_mindlin twisting alone": Scene(law="hertz_mindlin_rolling", rolling_friction=0.0, **TWISTED),
    "without friction": Scene(law="spring_dashpot", friction=0.0),
}


def vector(values):
    return Vector(*np.asarray(values, dtype=float).tolist())


def stiffness_of(scene):
    law = scene.contact_law
    return float(law.normal_stiffness(scene, np.array(A), np.array(B)))


def contact_of(scene, branch, velocity, spin_a=(0, 0, 0), spin_b=(0, 0, 0)):
    distance = float(np.linalg.norm(branch))
    normal = np.asarray(branch) / distance
    return Contact(
        stiffness_of(scene),
        A,
        B,
        A + B - distance,
        1.0 / distance,
        *(vector(v) for v in (branch, normal, velocity, spin_a, spin_b)),
    )


def stored(scene, contact, t, m):
    """Energy of the springs of a contact, J."""
    law, k, depth = scene.contact_law, contact.stiffness, max(contact.overlap, 0.0)
    kt = law.tangential.stiffness(law.tangential.share(scene), k, depth)
    twist = dot(m, contact.normal)
    bend = m - twist * contact.normal
    energy = law.normal.energy(k, depth)
    if depth == 0.0:
        return energy
    energy += 0.5 * dot(t, t) / kt
    for kind, squared in (("rolling", dot(bend, bend)), ("twisting", twist**2)):
        if squared > 0.0:
            part = getattr(law, kind)
            energy += 0.5 * squared / part.stiffness(part.numbers(scene), kt, A, B)
    return energy


def history_of(composition, **known):
    """The history of a contact without any, but for some columns."""
    zero = {name: ZERO if column.size > 1 else 0.0 for name, column in composition.columns.items()}
    return composition.make_history(**zero | {name: value for name, value in known.items() if name in zero})


def drive(scene, velocities, spins, dt, overlap=3e-7):
    """Move the second grain from a given overlap along x: (work done on the contact, contacts, responses) per step."""
    law = scene.contact_law
    composition, numbers = law.composition(scene), law.numbers(scene)
    branch, history = np.array([A + B - overlap, 0.0, 0.0]), history_of(composition)
    for velocity, (spin_a, spin_b) in zip(velocities, spins, strict=True):
        branch = branch + dt * velocity
        contact = contact_of(scene, branch, velocity, spin_a, spin_b)
        r = composition.pair(contact, history, numbers, dt)
        history = r.history
        work = dt * (np.dot(r.force, velocity) - np.dot(r.torque_a, spin_a) - np.dot(r.torque_b, spin_b))
        yield work, contact, r


@pytest.mark.parametrize("name", LAWS)
def test_the_force_of_each_normal_part_is_the_derivative_of_its_energy(name):
    law = LAWS[name]
    require_potential(law)
    overlap = np.geomspace(1e-9, 1e-5, 30)
    tangent = (law.normal.force(2.0, 1.0001 * overlap) - law.normal.force(2.0, 0.9999 * overlap)) / (2e-4 * overlap)
    np.testing.assert_allclose(tangent, law.normal.tangent(2.0, overlap), rtol=1e-7)


class WithoutPotential(lk.laws.LinearSpring):
    """A force that its energy does not give."""

    @staticmethod
    def force(stiffness, overlap):
        return 1.001 * stiffness * overlap


def test_a_part_whose_force_is_not_the_derivative_of_its_energy_is_refused():
    class Refused(lk.ContactLaw):
        name = "refused"
        parts = WithoutPotential() + lk.laws.Coulomb()

    with pytest.raises(InputError, match="refused: the force of WithoutPotential is not the derivative of its energy"):
        lk.register_law(Refused)
    assert "refused" not in LAWS


def test_a_part_with_a_history_that_its_kind_cannot_have_is_refused():
    coulomb = lk.laws.Coulomb
    slid = {**coulomb.history, "slid": lk.laws.Column("m", "distance slid")}
    heat = {**coulomb.losses, "heat_loss": "energy lost as heat"}
    remembering = type("Remembering", (coulomb,), {"history": slid})
    for part in (remembering, type("Warming", (coulomb,), {"losses": heat})):
        with pytest.raises(InputError, match=f"^{part.__name__} has columns of history or losses that a tangential"):
            type("Law", (lk.ContactLaw,), {"name": "law", "parts": lk.laws.LinearSpring() + part()})


def test_a_law_without_a_normal_part_is_refused():
    with pytest.raises(InputError, match=r"^the contact law Law has no normal part: add one"):
        type("Law", (lk.ContactLaw,), {"name": "law", "parts": lk.laws.Coulomb() + lk.laws.LocalDamping()})


def test_a_parameter_with_the_name_of_another_one_is_refused():
    def law(**parameters):
        part = type("Own", (lk.laws.LinearSpring,), {"parameters": parameters})
        return type("Law", (lk.ContactLaw,), {"name": "law", "parts": part() + lk.laws.LocalDamping()})

    for name in ("friction", "time_step", "mass"):
        with pytest.raises(InputError, match=rf"^a scene has another {name}: give the parameter of the law another"):
            lk.register_law(law(**{name: lk.parameter(0.1, help="another")}))
    with pytest.raises(InputError, match=r"^stickiness is not a parameter: give its name and labkit.parameter"):
        lk.register_law(law(stickiness=0.1))
    assert "law" not in LAWS
    own = type("Own", (lk.laws.LinearSpring,), {"parameters": {"friction": lk.parameter(0.1, help="another")}})
    with pytest.raises(InputError, match=r"^two parts of a contact law have different parameters named friction"):
        own() + lk.laws.Coulomb()


@pytest.mark.parametrize("changes", [TWISTED, {"limits": "forces"}])
def test_options_of_parts_that_a_law_lacks_are_refused(changes):
    for law in ("hertz_mindlin", "hertz_mindlin_dashpot"):
        with pytest.raises(InputError, match="the contact law hertz_mindlin"):
            Scene(law=law, **changes)
    with pytest.raises(InputError, match=r"^limits forces "):
        Scene(limits="forces")


@pytest.mark.parametrize("name", SCENES)
def test_the_compiled_law_is_the_plain_one(name):
    scene = SCENES[name]
    law, random = scene.contact_law, np.random.default_rng(2)
    composition, numbers = law.composition(scene), law.numbers(scene)
    pair = Translation().inline(composition.pair)

    @numba.njit
    def compiled(contact, history, numbers, dt):
        return pair(contact, history, numbers, dt)

    for overlap in (-1e-6, 1e-8, 1e-6):
        direction = random.normal(size=3)
        branch = (A + B - overlap) * direction / np.linalg.norm(direction)
        contact = contact_of(scene, branch, *(random.normal(0.0, s, 3) for s in (1e-2, 100.0, 100.0)))
        t, m = (vector(np.cross(random.normal(0.0, s, 3), contact.normal)) for s in (1e-3, 1e-8))
        history = history_of(composition, tangential_force=t, rolling_moment=m)
        ours, theirs = (f(contact, history, numbers, 1e-7) for f in (composition.pair, compiled))
        for a, b in zip((*ours[:3], *ours[3], *ours[4]), (*theirs[:3], *theirs[3], *theirs[4]), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14 * np.abs(np.ravel(b)).max())


@pytest.mark.parametrize("name", SCENES)
def test_work_is_stored_or_lost(name):
    """Tests loading, slip, rolling and twisting together, back and forth, sticking and sliding."""
    scene = SCENES[name]
    steps, dt = 6000, 1e-9
    phase = np.linspace(0.0, 2.0 * np.pi, steps)
    push = 2e-7 * np.pi / (steps * dt)
    velocities = np.stack([-push * np.sin(phase), 2.0 * push * np.cos(phase), 0.5 * push * np.cos(2 * phase)], axis=1)
    spins = np.zeros((steps, 2, 3))
    spins[:, 0, 0], spins[:, 1, 2] = 2e3 * np.cos(phase), 3e3 * np.sin(phase)
    work = losses = largest = 0.0
    at_first = stored(scene, contact_of(scene, [A + B - 3e-7, 0.0, 0.0], ZERO), ZERO, ZERO)
    for done, at, r in drive(scene, velocities, spins, dt):
        work, contact = work + done, at
        losses += sum(r.losses)
        largest = max(largest, work)
    t, m = (getattr(r.history, name, ZERO) for name in ("tangential_force", "rolling_moment"))
    change = stored(scene, contact, t, m) - at_first
    assert losses > 0.1 * largest
    assert abs(work - losses - change) < 0.02 * largest


def test_the_twisting_moment_is_that_of_the_closed_form():
    """A spring kt r*^2 up to mu_t r* fn; beyond it the loss is moment times angle."""
    scene = Scene(law="spring_dashpot", rolling_friction=0.0, friction=0.0, beta_n=0.0, beta_t=0.0, **TWISTED)
    kt = stiffness_of(scene) / 2.0
    limit, stiffness = 0.15 * REDUCED * stiffness_of(scene) * 3e-7, kt * REDUCED**2
    rate, dt, steps = 1e3, 1e-8, 4000
    assert rate * dt * steps > 2.0 * limit / stiffness
    moments, lost = [], 0.0
    spins = [((0, 0, 0), (rate, 0, 0))] * steps
    for _, _, r in drive(scene, np.zeros((steps, 3)), spins, dt):
        moments.append(r.torque_a.x)
        lost += sum(r.losses)
        assert r.torque_b == opposite(r.torque_a) and r.history.rolling_moment[1:] == (0.0, 0.0)
    angle = rate * dt * np.arange(1, steps + 1)
    np.testing.assert_allclose(moments, np.minimum(stiffness * angle, limit), rtol=1e-9)
    assert np.isclose(lost, limit * (angle[-1] - limit / stiffness), rtol=1e-3)


def loop(law):
    """Shear at a large overlap, unload, shear back and load again: (losses per step, work, change of stored energy)."""
    scene = Scene(law=law, friction=5.0)  # no sliding: all loss is that of the changing stiffness
    dt, steps = 1e-9, 6000
    speed = 1e-7 / (dt * steps)
    legs = [(0, speed), (0.9 * speed * 3, 0), (0, -speed), (-0.9 * speed * 3, 0)]
    velocities = np.repeat([(x, y, 0.0) for x, y in legs], steps, axis=0)
    still = np.zeros(3)
    losses, work = [], 0.0
    for done, at, r in drive(scene, velocities, [(still, still)] * len(velocities), dt):
        losses.append(r.losses.friction_loss)
        work, contact = work + done, at
    start = stored(scene, contact_of(scene, [A + B - 3e-7, 0.0, 0.0], ZERO), ZERO, ZERO)
    return np.array(losses), work, stored(scene, contact, r.history.tangential_force, ZERO) - start


def test_the_rescaled_spring_creates_no_energy():
    losses, work, change = loop("hertz_mindlin_rescaled")
    assert losses.min() > -1e-9 * losses.max() and losses.sum() > 0.0
    assert abs(work - losses.sum() - change) < 0.01 * losses.sum()  # the error is proportional to the step
    created, *_ = loop("hertz_mindlin")  # Mindlin's spring creates energy while it is unloaded
    assert created.min() < -0.1 * created.max()


@pytest.mark.parametrize("limits", ["springs", "forces"])
def test_what_the_limit_of_eq_2_applies_to(limits):
    scene = Scene(law="spring_dashpot", limits=limits, rolling_friction=0.0)
    velocity, still = np.array([[0.02, 0.5, 0.0]] * 800), np.zeros(3)
    ratios = []
    for _, contact, r in drive(scene, velocity, [(still, still)] * 800, 1e-8):
        fn = dot(r.force, contact.normal)
        ratios.append(np.linalg.norm(r.force - fn * contact.normal) / abs(fn))
    if limits == "forces":
        assert np.isclose(ratios[-1], scene.friction, rtol=1e-9) and max(ratios) < scene.friction * (1.0 + 1e-9)
    else:
        assert ratios[-1] > 1.01 * scene.friction


@pytest.fixture
def memory():
    """A pull of 1 mN on grains that touched once, with the energy of one of 2 mN; then forgotten."""

    class Memory(lk.laws.LawPart):
        kind = "memory"
        history = MappingProxyType({"touched": lk.laws.Column("1", "1 where the grains touched", joins=True)})

        def begin(self, overlap):
            return {"touched": 1.0 * (overlap >= 0.0)}

        @staticmethod
        def respond(step, history, numbers, carry):
            touched = 1.0 if step.contact.overlap >= 0.0 else history.touched
            return lk.laws.Share(1e-3 * touched, ZERO, ZERO, (touched,), ())

        @staticmethod
        def normal_force(contact, history, numbers):
            return -1e-3 * history.touched

        @staticmethod
        def stored_energy(contact, history, numbers):
            return -2e-3 * history.touched * contact.overlap

    return Memory


def test_two_histories_of_one_name_are_refused(memory):
    class Glue(memory):
        kind = "glue"
        history = MappingProxyType({"touched": lk.laws.Column("1", "something else")})

    with pytest.raises(InputError, match="two parts of a contact law keep a history named touched: rename one"):
        memory() + Glue()


def test_a_part_whose_force_does_not_fit_its_energy_is_refused_before_it_is_compiled(memory):
    class Remembering(lk.ContactLaw):
        name = "spring_dashpot"  # for the scene; it is not registered
        parts = lk.laws.LinearSpring() + lk.laws.LocalDamping() + memory()

    with pytest.raises(InputError, match="the normal_force of its parts is not the derivative of their stored_energy"):
        try_out(Remembering())


def test_a_state_whose_history_does_not_fit_is_refused():
    state = grains_in_cell(Scene(), np.full(2, A), np.array([[1e-4] * 3, [4e-4] * 3]), 1e-3 * np.eye(3))
    with pytest.raises(InputError, match="joined has the wrong shape"):
        FusedEngine(state.replace(columns={"joined": np.zeros((1, 2))}))
    with pytest.raises(InputError, match="no part of a contact law keeps a history named foo"):
        FusedEngine(state.replace(columns={"foo": np.zeros(0)}))
