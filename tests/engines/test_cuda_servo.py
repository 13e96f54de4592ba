"""The servo on the device, in the simulator, against that of the host."""

import numpy as np
import pytest

from labkit.engines.fused import FusedEngine
from labkit.grains.scene import Scene
from labkit.paths.control import Control
from labkit.paths.registry import PATHS
from labkit.paths.standard import ConstantVolume
from labkit.paths.step import Here
from labkit.servo.correction import STANDARD, cell_stiffness
from labkit.servo.plan import correcting_of, corrections_of, prescribed_gradient, velocity_gradient
from tests.engines.simulated_gpu import CudaEngine, lattice

pytestmark = pytest.mark.slow

RATE = 20.0
INTERVALS = (5, 5, 2)  # steps


class Isochoric(ConstantVolume):
    """Axial compression at constant volume that also holds a difference of two stresses, by rates without a volume."""

    name = "isochoric_of_test"

    def control(self):
        return Control([[1.0, -1.0, 0.0]], [[1.0], [-1.0], [0.0]], [1e5])


@pytest.fixture(scope="module")
def moving():
    """Eight grains that move, and the mean stress, Pa."""
    engine = FusedEngine(lattice(2, 1, Scene(law="spring_dashpot", friction=0.3)))
    engine.advance(10, np.diag([1.0, 2.0, -3.0]) * RATE)
    state = engine.state()
    return state, float(np.trace(engine.stress())) / 3.0


@pytest.mark.parametrize("kind", ["cp", "simple_shear", "stress_rotation", "isochoric"])
def test_the_servo_on_the_device_finds_the_rates_of_the_servo_of_the_host(kind, moving):
    state, pressure = moving
    pressure *= 1.0001  # rates within their limits
    if kind == "isochoric":
        path = Isochoric(rate=RATE)
    else:
        path = PATHS[kind](rate=RATE, **({"pressure": pressure} if kind == "cp" else {}))
    path = path.starting_at(pressure)
    (step,), dt = path.steps_from(Here()), state.time_step
    stiffness = cell_stiffness(state.snapshot(), step.held.components)

    host, gradient, done = FusedEngine(state), state.velocity_gradient, 0
    strains = []
    for steps in INTERVALS:
        travelled = RATE * dt * done
        strains.append(travelled)
        gradient = velocity_gradient(step, RATE, dt, host.stress(), stiffness, gradient, STANDARD, travelled)
        host.advance(steps, gradient)
        done += steps
    device = CudaEngine(state)
    servo = correcting_of(step, RATE, stiffness, dt, STANDARD)
    device.follow(corrections_of(step, RATE, dt, servo, INTERVALS, strains))

    ours, expected = device.state(), host.state()
    assert ours.step == state.step + sum(INTERVALS)
    largest = np.abs(expected.velocity_gradient).max()
    assert np.abs(ours.velocity_gradient - expected.velocity_gradient).max() < 1e-9 * largest
    prescribed = prescribed_gradient(ConstantVolume(rate=RATE), dt)
    assert np.abs(expected.velocity_gradient - prescribed).max() > 1e-3 * largest  # the servo does something
    assert np.abs(ours.cell - expected.cell).max() < 1e-13 * expected.cell.max()
    assert np.abs(ours.velocity - expected.velocity).max() < 1e-9 * np.abs(expected.velocity).max()


def test_a_servo_that_starts_anew_forgets_the_rates_so_far(moving):
    """The first rates are a quarter of those that the stress requires, and do not depend on earlier rates."""
    state, pressure = moving
    path = PATHS["cp"](rate=RATE, pressure=1.0001 * pressure)
    (step,) = path.steps_from(Here())
    stiffness = cell_stiffness(state.snapshot())
    dt = state.time_step
    servo = correcting_of(step, RATE, stiffness, dt, STANDARD)
    device = CudaEngine(state)
    device.follow(corrections_of(step, RATE, dt, servo, [1], [0.0], anew=True))
    arguments = step, RATE, state.time_step, FusedEngine(state).stress(), stiffness
    expected = velocity_gradient(*arguments, np.zeros((3, 3)))
    assert np.allclose(device.state().velocity_gradient, expected, rtol=1e-9)
    assert not np.allclose(expected, velocity_gradient(*arguments, state.velocity_gradient), rtol=1e-3)
