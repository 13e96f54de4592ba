"""Cost of a time step of the fused engine for each contact law, on the same grains."""

from __future__ import annotations

import dataclasses
import statistics
from functools import partial

from benchmarks.kernel import TimedEngine, contact_seconds
from benchmarks.rounds import alternate, ratio
from labkit.engines.base import Progress
from labkit.grains.laws import LAWS
from labkit.grains.state import State

HERTZIAN_MODULUS = 32.0  # multiple of the linear laws' modulus that gives about the same overlap at 500 kPa


def laws(state: State, steps: int, rounds: int, progress: Progress) -> str:
    """Tabulate the CPU time per step of every registered law, without neighbour searches: medians of rounds."""
    engines = {}
    for name in LAWS:
        scene = dataclasses.replace(state.scene, law=name)
        if name.startswith("hertz_mindlin"):
            scene = dataclasses.replace(scene, young_modulus=HERTZIAN_MODULUS * scene.young_modulus)
        engines[name] = TimedEngine(state.replace(scene=scene, time_step=min(state.time_step, scene.time_step)))
    starts = {name: engine.state() for name, engine in engines.items()}
    measures = {name: partial(contact_seconds, engine, starts[name], steps) for name, engine in engines.items()}
    measured = alternate(measures, rounds + 1, progress)  # the first round compiles
    contacts = len(state.contact_grain)
    lines = [f"{state.number_of_grains} grains, {contacts} contacts; one thread; medians of {rounds} rounds"]
    lines.append(f"{'law':<24} {'us/step':>9} {'ns/contact':>11} {'ratio':>7} {'range':>13} {'time step, ns':>14}")
    base = measured[next(iter(engines))][1:]
    for name, turns in measured.items():
        seconds = statistics.median(turns[1:])
        lines.append(
            f"{name:<24} {1e6 * seconds:9.1f} {1e9 * seconds / contacts:11.2f} "
            f"{ratio(turns[1:], base)} {1e9 * starts[name].scene.time_step:14.1f}"
        )
    return "\n".join(lines)
