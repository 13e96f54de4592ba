"""What a run needs of an engine. A run is a generator that yields these requests and receives the answers.

A request is a Load, an Advance, Corrections, Work, or a function of the engine. `drive` answers from one engine;
other drivers answer the requests of several runs, or of a test.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Generator
from typing import Any, TypeVar

import numpy as np

from labkit.engines.base import Engine, Start
from labkit.grains.state import State
from labkit.servo.plan import Corrections

Result = TypeVar("Result")


@dataclasses.dataclass(frozen=True)
class Load:
    """Load a State, with the first engine or with the one that is there; the answer is its Abilities."""

    state: State


@dataclasses.dataclass(frozen=True)
class Advance:
    """Advance a number of time steps with a velocity gradient (3, 3), 1/s."""

    steps: int
    velocity_gradient: np.ndarray


@dataclasses.dataclass(frozen=True)
class Work:
    """Work that does not use the engine; other States may advance meanwhile. The answer is its result.

    It may be done in another thread, at the same time as that of other runs: it must use no files.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()


Request = Load | Advance | Corrections | Work | Callable[[Engine], Any]


def drive(run: Generator[Request, Any, Result], start: Start) -> Result:
    """Carry out a run with one engine; returns its result. Raises what the run or the engine raises."""
    engine: Engine | None = None
    try:
        request = next(run)
        while True:
            try:
                if engine is None:
                    assert isinstance(request, Load), "a run begins with Load"
                    engine = start(request.state)
                    answer = engine.abilities
                else:
                    answer = answer_of(engine, request)
            except BaseException as error:  # the run closes its files
                request = run.throw(error)
            else:
                request = run.send(answer)
    except StopIteration as end:
        return end.value


def answer_of(engine: Engine, request: Request) -> Any:
    """The answer of an engine to a request."""
    match request:
        case Advance(steps, gradient):
            return engine.advance(steps, gradient)
        case Corrections():
            assert engine.abilities.follow is not None
            return engine.abilities.follow(engine, request)
        case Work(function, arguments):
            return function(*arguments)
        case Load(state):
            engine.load(state)
            return engine.abilities
        case _:
            return request(engine)
