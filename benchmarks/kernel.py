"""Cost of the fused engine by feature, and relative to the limits of the hardware."""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numba
import numpy as np

from benchmarks.rounds import alternate
from labkit.engines.base import Progress
from labkit.engines.fused import FusedEngine
from labkit.engines.kernel.layout import HISTORY, SITE_W, WIDTH, Arrays
from labkit.engines.kernel.packing import PackedArrays
from labkit.engines.kernel.translate import OPTIONS
from labkit.grains.scene import Scene
from labkit.grains.state import State, grains_in_cell
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.servo.correction import STANDARD
from labkit.servo.plan import prescribed_gradient

FIRST = "rolling_resistance law, all features"
FLOPS = {"rolling_resistance": 300, "spring_dashpot": 390}  # operations per contact, counted in the formulas


def copies(state: State, times: Sequence[int]) -> State:
    """Replicate the specimen `times` (3,) times in the three directions: a larger cell, the same physics."""
    shifts = np.stack(np.meshgrid(*[np.arange(n) for n in times], indexing="ij"), axis=-1).reshape(-1, 3)
    many, number = len(shifts), state.number_of_grains
    position = (state.position[None] + (shifts @ state.cell.T)[:, None]).reshape(-1, 3)
    result = grains_in_cell(state.scene, np.tile(state.radius, many), position, state.cell * np.array(times))
    # the second grain of a contact may lie in another copy, or in another period beyond the last copy
    period, copy = np.divmod(shifts[:, None] + state.contact_shift[None], times)
    second = state.contact_grain[:, 1] + number * np.ravel_multi_index(np.moveaxis(copy, -1, 0), times)
    first = np.broadcast_to(state.contact_grain[:, 0] + number * np.arange(many)[:, None], second.shape)
    grain, shift = np.stack([first, second], axis=-1).reshape(-1, 2), period.reshape(-1, 3)
    swap = (grain[:, 0] > grain[:, 1])[:, None]  # a State lists the smaller index first
    sign = np.where(swap, -1, 1)
    return result.replace(
        velocity=np.tile(state.velocity, (many, 1)),
        angular_velocity=np.tile(state.angular_velocity, (many, 1)),
        velocity_gradient=state.velocity_gradient,
        time_step=state.time_step,
        contact_grain=np.where(swap, grain[:, ::-1], grain).astype(np.int32),
        contact_shift=(shift * sign).astype(np.int32),
        tangential_force=np.tile(state.tangential_force, (many, 1)) * sign,
        rolling_moment=np.tile(state.rolling_moment, (many, 1)) * sign,
    )


def features(state: State, steps: int, rounds: int, progress: Progress) -> str:
    """Tabulate the time per step with individual features switched off; medians of alternating rounds."""
    engines: dict[str, tuple[TimedEngine, bool]] = {}

    def add(name: str, scene: Scene, energy: bool = True, sampled: bool = False) -> None:
        engine = TimedEngine(state.replace(scene=scene))
        engine.energy = energy
        engines[name] = engine, sampled

    yade = dataclasses.replace(state.scene, law="rolling_resistance")
    add(FIRST, yade)
    add("... plus the stress every 5 steps", yade, sampled=True)
    add("... without energy sums", yade, energy=False)
    add("... without local damping", dataclasses.replace(yade, local_damping=0.0))
    add("... without rolling", dataclasses.replace(yade, rolling_friction=0.0))
    add("... without rolling and friction", dataclasses.replace(yade, rolling_friction=0.0, friction=0.0))
    dashpots = dataclasses.replace(yade, law="spring_dashpot")
    add("spring_dashpot law, all features", dashpots)
    add("... without dashpots", dataclasses.replace(dashpots, beta_n=0.0, beta_t=0.0))
    measures = {  # every round starts from the same state, because a specimen without friction collapses
        name: partial(contact_seconds, engine, state.replace(scene=engine.state().scene), steps, sampled)
        for name, (engine, sampled) in engines.items()
    }
    measured = alternate(measures, rounds + 1, progress)  # the first round compiles
    lines = [
        f"{state.number_of_grains} grains, {len(state.contact_grain)} contacts; one thread; medians of {rounds} "
        "rounds, without neighbour searches"
    ]
    lines.append(f"{'':<36} {'us/step':>9} {'ns/contact':>11} {'of total, %':>11}")
    base = statistics.median(measured[FIRST][1:])
    for name, turns in measured.items():
        seconds = statistics.median(turns[1:])
        ns = 1e9 * seconds / len(state.contact_grain)
        lines.append(f"{name:<36} {1e6 * seconds:9.1f} {ns:11.2f} {100 * seconds / base:11.1f}")
    lines += ["", *_search_share(state, 40 * steps), "", *_limit(state.replace(scene=yade), base)]
    return "\n".join(lines)


class TimedEngine(FusedEngine):
    """A FusedEngine that lists the CPU seconds of each neighbour search in `searches`."""

    def __init__(self, state: State, precision: str = "double") -> None:
        """Load the state."""
        self.searches: list[float] = []
        super().__init__(state, precision=precision)

    def _search_again(self) -> None:
        begin = time.process_time()
        super()._search_again()
        self.searches.append(time.process_time() - begin)


def seconds_per_step(engine: FusedEngine, state: State, steps: int, sampled: bool = False) -> float:
    """Measure the CPU seconds per step under shear, with the stress sums of a servo if `sampled`.

    The engine uses one thread, whose CPU time other jobs on the computer hardly change.
    """
    gradient = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step)
    begin = time.process_time()
    if sampled:
        for _ in range(steps // STANDARD.interval):
            engine.advance(STANDARD.interval, gradient)
            engine.stress()
    else:
        engine.advance(steps, gradient)
    return (time.process_time() - begin) / steps


def contact_seconds(engine: TimedEngine, start: State, steps: int, sampled: bool = False) -> float:
    """Measure CPU seconds per step from a state, without neighbour searches; arguments as in `seconds_per_step`."""
    engine.load(start)
    engine.searches.clear()
    return seconds_per_step(engine, start, steps, sampled) - sum(engine.searches) / steps


def _search_share(state: State, steps: int) -> Iterator[str]:
    engine = TimedEngine(state)
    total, searches = steps * seconds_per_step(engine, state, steps), engine.searches
    pairs, images = len(engine.packing.slot), len(engine.packing.arrays.owner)
    yield f"neighbour searches: {len(searches)} in {steps} steps, {100 * sum(searches) / total:.1f} % of the time"
    yield f"stored pairs: {pairs} for {len(state.contact_grain)} contacts; images: {images}"


def _limit(state: State, seconds: float) -> Iterator[str]:
    """Compare the memory traffic and the operations of one step with the measured limits of this core."""
    packing = FusedEngine(state).packing
    pairs = len(packing.slot)
    contact_bytes, site_bytes, grain_bytes = traffic(packing.arrays)
    moved = bytes_per_step(packing)
    flops = pairs * FLOPS[state.scene.law] + state.number_of_grains * 120
    bandwidth, peak = bandwidth_of(3_000_000), peak_flops()
    yield (
        f"memory traffic in bytes per pair: {contact_bytes}, per site: {site_bytes}, per grain: {grain_bytes}; "
        f"{moved / 1e6:.1f} MB per step, if data that contacts share stay in the first-level cache"
    )
    yield f"operations per pair: about {FLOPS[state.scene.law]}; {flops / 1e6:.1f} MFLOP per step"
    yield f"this core: {bandwidth / 1e9:.0f} GB/s on arrays of 3 MB, {peak / 1e9:.0f} GFLOP/s of fused multiply-adds"
    yield (
        f"lower bound per step: {1e6 * moved / bandwidth:.0f} us for the memory traffic, {1e6 * flops / peak:.0f} us "
        f"for the operations; measured: {1e6 * seconds:.0f} us"
    )


def traffic(arrays: Arrays) -> tuple[int, int, int]:
    """Bytes that one step reads and writes per pair, per site and per grain."""
    history = arrays.blocks[0, HISTORY:].nbytes  # these are also written
    contact_bytes = (arrays.blocks[0].nbytes + history) // WIDTH + arrays.pairs[:, 0].nbytes
    # contacts read places and motions and grains write them; both read and write the forces
    site_bytes = 2 * (arrays.places[0].nbytes + arrays.motions[0].nbytes) + 4 * arrays.forces[0].nbytes
    moved = arrays.places[0].nbytes + arrays.motions[0, SITE_W:].nbytes  # grains also read these
    grain_bytes = moved + (2 * arrays.grains[0].nbytes + arrays.masses[0].nbytes) // WIDTH
    return contact_bytes, site_bytes, grain_bytes


def bytes_per_step(packing: PackedArrays) -> float:
    """Bytes that one step reads and writes, if data that contacts share stay in the first-level cache."""
    contact_bytes, site_bytes, grain_bytes = traffic(packing.arrays)
    of_pairs = len(packing.slot) * contact_bytes
    return of_pairs + len(packing.arrays.places) * site_bytes + len(packing.order) * grain_bytes


def bandwidth_of(size: int) -> float:
    """Measure the bytes per second that one core reads and writes in a = b + c with arrays of `size` bytes in all."""
    a, b, c = np.ones((3, size // 24))
    best = min(_time(lambda: np.add(b, c, out=a)) for _ in range(max(5, min(200, 600_000_000 // size))))
    return 3 * a.nbytes / best


@numba.njit(**OPTIONS)
def _multiply_add(x: np.ndarray, n: int) -> float:
    for _ in range(n):
        for i in range(64):
            x[i] = x[i] * 0.999 + 1e-3
            x[64 + i] = x[64 + i] * 0.999 + 1e-3
    return x[0]


def peak_flops() -> float:
    """Measure the multiplications and additions per second of one core on short arrays."""
    x = np.ones(128)
    _multiply_add(x, 10)
    return 2 * 128 * 20_000 / min(_time(lambda: _multiply_add(x, 20_000)) for _ in range(20))


def _time(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin
