"""What the engine fused costs: feature by feature, size by size, and beside what the computer can do."""

from __future__ import annotations

import dataclasses
import resource
import statistics
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from labkit.dem.engine import Progress
from labkit.dem.paths import ConstantVolume
from labkit.dem.scene import Scene
from labkit.dem.servo import STANDARD, velocity_gradient
from labkit.dem.state import State, grains_in_cell
from labkit.engines.fused import FusedEngine
from labkit.engines.kernel.compiling import compiled
from labkit.engines.kernel.layout import FORCE_COLUMNS, SITE_COLUMNS, WIDTH
from labkit.engines.kernel.packing import ordered

FIRST = "law rolling_resistance, everything"
SIZES = (1_000, 10_000, 40_000, 100_000)  # grains, about: copies of the specimen
FLOPS = {"rolling_resistance": 300, "spring_dashpot": 390}  # of a contact with everything, counted in the formulas


def copies(state: State, times: Sequence[int]) -> State:
    """The same grains `times` (3,) times in the three directions: another cell, the same physics."""
    shifts = np.stack(np.meshgrid(*[np.arange(n) for n in times], indexing="ij"), axis=-1).reshape(-1, 3)
    many, number = len(shifts), state.number_of_grains
    position = (state.position[None] + (shifts @ state.cell.T)[:, None]).reshape(-1, 3)
    result = grains_in_cell(state.scene, np.tile(state.radius, many), position, state.cell * np.array(times))
    # the second grain of a contact lies in another copy, or beyond the last one in another period
    period, copy = np.divmod(shifts[:, None] + state.contact_shift[None], times)
    second = state.contact_grain[:, 1] + number * np.ravel_multi_index(np.moveaxis(copy, -1, 0), times)
    first = np.broadcast_to(state.contact_grain[:, 0] + number * np.arange(many)[:, None], second.shape)
    history = ordered(
        np.stack([first, second], axis=-1).reshape(-1, 2),
        period.reshape(-1, 3),
        np.tile(np.concatenate([state.tangential_force, state.rolling_moment], axis=1), (many, 1)),
    )
    return result.replace(
        velocity=np.tile(state.velocity, (many, 1)),
        angular_velocity=np.tile(state.angular_velocity, (many, 1)),
        velocity_gradient=state.velocity_gradient,
        time_step=state.time_step,
        contact_grain=history.grain.astype(np.int32),
        contact_shift=history.shift.astype(np.int32),
        tangential_force=history.rows[:, :3].copy(),
        rolling_moment=history.rows[:, 3:].copy(),
    )


def features(state: State, steps: int, rounds: int, progress: Progress) -> str:
    """Table of the time per step with one thing left out after another; rounds in turn, medians."""
    engines: dict[str, tuple[FusedEngine, bool]] = {}

    def add(name: str, scene: Scene, energy: bool = True, sampled: bool = False) -> None:
        engine = FusedEngine(state.replace(scene=scene))
        engine.energy = energy
        engines[name] = engine, sampled

    yade = dataclasses.replace(state.scene, law="rolling_resistance")
    add(FIRST, yade)
    add("... stress every 5 steps as well", yade, sampled=True)
    add("... without energy sums", yade, energy=False)
    add("... without local damping", dataclasses.replace(yade, local_damping=0.0))
    add("... without rolling", dataclasses.replace(yade, rolling_friction=0.0))
    add("... without rolling and friction", dataclasses.replace(yade, rolling_friction=0.0, friction=0.0))
    dashpots = dataclasses.replace(yade, law="spring_dashpot")
    add("law spring_dashpot, everything", dashpots)
    add("... without dashpots", dataclasses.replace(dashpots, beta_n=0.0, beta_t=0.0))
    searches = {name: _watch_search(engine) for name, (engine, _) in engines.items()}
    found: dict[str, list[float]] = {name: [] for name in engines}
    for turn in range(rounds + 1):  # the first one compiles
        for number, (name, (engine, sampled)) in enumerate(engines.items()):
            progress((turn * len(engines) + number) / ((rounds + 1) * len(engines)), name)
            # from the same state in every turn: without friction a specimen would collapse
            engine.load(state.replace(scene=engine.state().scene))
            searches[name].clear()
            seconds = _seconds_per_step(engine, state, steps, sampled)
            found[name].append(seconds - sum(searches[name]) / steps)
    progress(1.0, "done")
    lines = [
        f"{state.number_of_grains} grains, {len(state.contact_grain)} contacts; one thread; medians of {rounds}, "
        "searches left out"
    ]
    lines.append(f"{'':<36} {'us/step':>9} {'ns/contact':>11} {'of all, %':>10}")
    base = statistics.median(found[FIRST][1:])
    for name, turns in found.items():
        seconds = statistics.median(turns[1:])
        ns = 1e9 * seconds / len(state.contact_grain)
        lines.append(f"{name:<36} {1e6 * seconds:9.1f} {ns:11.2f} {100 * seconds / base:10.1f}")
    lines += ["", *_search_share(state, 40 * steps), "", *_limit(state.replace(scene=yade), base)]
    return "\n".join(lines)


def _seconds_per_step(engine: FusedEngine, state: State, steps: int, sampled: bool = False) -> float:
    gradient = velocity_gradient(ConstantVolume(), 1.0, state.time_step)
    begin = time.perf_counter()
    if sampled:
        for _ in range(steps // STANDARD.interval):
            engine.advance(STANDARD.interval, gradient)
            engine.stress()
    else:
        engine.advance(steps, gradient)
    return (time.perf_counter() - begin) / steps


def _watch_search(engine: FusedEngine) -> list[float]:
    """A list that gets the seconds of each search of the engine from now on."""
    search, spent = engine._search_again, []

    def timed() -> None:
        begin = time.perf_counter()
        search()
        spent.append(time.perf_counter() - begin)

    engine._search_again = timed
    return spent


def _search_share(state: State, steps: int) -> Iterator[str]:
    engine = FusedEngine(state)
    spent = _watch_search(engine)
    whole = steps * _seconds_per_step(engine, state, steps)
    pairs, images = len(engine._packing.slot), len(engine._packing.arrays.owner)
    yield f"neighbour search: {len(spent)} in {steps} steps, {100 * sum(spent) / whole:.1f} % of the time"
    yield f"pairs kept at hand: {pairs} for {len(state.contact_grain)} contacts; images: {images}"


def _limit(state: State, seconds: float) -> Iterator[str]:
    """What one step moves and computes against what this core can, measured now."""
    packing = FusedEngine(state)._packing
    pairs, rows = len(packing.slot), packing.arrays.blocks.shape[1] // WIDTH
    contact_bytes = 8 * (rows + 6 + 1)  # the history is written back
    site_bytes = 8 * (2 * SITE_COLUMNS + 4 * FORCE_COLUMNS)  # contacts read, grains write sites; of forces both do both
    grain_bytes = 8 * (11 + 9)
    moved = pairs * contact_bytes + len(packing.arrays.sites) * site_bytes + state.number_of_grains * grain_bytes
    flops = pairs * FLOPS[state.scene.law] + state.number_of_grains * 120
    bandwidth, peak = bandwidth_of_cache(), peak_flops()
    yield (
        f"bytes that pass per pair: {contact_bytes}, per site: {site_bytes}, per grain: {grain_bytes}; "
        f"{moved / 1e6:.1f} MB a step, if what contacts share stays in the nearest cache"
    )
    yield f"operations per pair: about {FLOPS[state.scene.law]}; {flops / 1e6:.1f} MFLOP a step"
    yield f"this core: {bandwidth / 1e9:.0f} GB/s on arrays of 3 MB, {peak / 1e9:.0f} GFLOP/s of fused multiply-adds"
    yield (
        f"a step could take {1e6 * moved / bandwidth:.0f} us for the bytes, {1e6 * flops / peak:.0f} us for the "
        f"operations; it takes {1e6 * seconds:.0f}"
    )


def bandwidth_of_cache() -> float:
    """Bytes per second that one core reads and writes in a = b + c on arrays of 1 MB each."""
    a, b, c = np.ones((3, 125_000))
    best = min(_time(lambda: np.add(b, c, out=a)) for _ in range(200))
    return 3 * a.nbytes / best


@compiled
def _multiply_add(x: np.ndarray, n: int) -> float:
    for _ in range(n):
        for i in range(64):
            x[i] = x[i] * 0.999 + 1e-3
            x[64 + i] = x[64 + i] * 0.999 + 1e-3
    return x[0]


def peak_flops() -> float:
    """Multiplications and additions per second of one core in short arrays."""
    x = np.ones(128)
    _multiply_add(x, 10)
    return 2 * 128 * 20_000 / min(_time(lambda: _multiply_add(x, 20_000)) for _ in range(20))


def _time(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def sizes(state: State, steps: int, progress: Progress) -> str:
    """Table of the time per grain and step, and of the memory, from about 1,000 to 100,000 grains."""
    lines = [f"{'grains':>8} {'steps/s':>9} {'ns per grain-step':>18} {'of the first':>13} {'peak memory, MB':>16}"]
    first = None
    engine = None
    for number, grains in enumerate(SIZES):
        progress(number / len(SIZES), f"{grains} grains")
        del engine
        times = max(1.0, (grains / state.number_of_grains) ** (1 / 3))
        times = [int(times) + (times % 1 > share) for share in (0.75, 0.5, 0.25)]
        many = copies(state, times)
        engine = FusedEngine(many)
        count = max(20, round(steps * 10_000 / many.number_of_grains))
        _seconds_per_step(engine, many, count // 5)
        seconds = min(_seconds_per_step(engine, many, count) for _ in range(5))
        each = 1e9 * seconds / many.number_of_grains
        first = first or each
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        lines.append(f"{many.number_of_grains:8d} {1 / seconds:9.1f} {each:18.1f} {each / first:13.2f} {memory:16.0f}")
    progress(1.0, "done")
    return "\n".join(lines)
