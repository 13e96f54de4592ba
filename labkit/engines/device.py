"""An engine and its hardware as one object, which is passed from the user to the engine."""

from __future__ import annotations

import dataclasses
import os
import traceback
from collections.abc import Callable, Generator
from typing import Literal, TypeAlias, cast

import numpy as np

from labkit.engines.base import ENGINES, Advance, Answer, Engine, Load, Request, Result, engine_class
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.process.interruption import require_owner
from labkit.servo.plan import Corrections

Precision: TypeAlias = Literal["double", "mixed"]

PRECISIONS = ("double", "mixed")  # all precisions that engines support


@dataclasses.dataclass(frozen=True)
class Device:
    """An engine and the hardware on which it runs: `device(state)` returns the engine, loaded with the state.

    Args:
        name: Name of the engine.
        threads: Number of threads, of each rank.
        precision: Precision of the computation, "double" or "mixed".
        ranks: Number of MPI ranks.

    Raises:
        InputError: If the engine is unknown or has no such number of threads or ranks.
    """

    name: str = "fused"
    threads: int = 1
    precision: str = "double"
    ranks: int = 1

    def __post_init__(self) -> None:
        """Import the engine, and check the numbers of threads and ranks."""
        parallel = engine_class(self.name).abilities.parallel
        for field, count in (("threads", self.threads), ("ranks", self.ranks)):
            if not isinstance(count, (int, np.integer)) or isinstance(count, bool) or count < 1:
                raise InputError(field=field, value=count, allowed="a whole number of at least 1", quoted=True)
            if count > 1 and field not in parallel:
                problem, allowed = f"do not apply to the engine {self.name}", f"{' or '.join(parallel)} instead"
                raise InputError(problem, field=field, value=count, allowed=allowed)

    def __call__(self, state: State) -> Engine:
        """Return the engine with the state loaded. Raises InputError if it does not support the scene or precision."""
        self.require_scene(state.scene)
        self.require_grains(state.clumps is not None)
        options = {} if self.precision == "double" else {"precision": self.precision}
        state, make = state.replace(precision=self.precision), cast(Callable[..., Engine], self.kind)
        if self.ranks > 1:
            from labkit.engines.on_ranks import OnRanks

            return OnRanks(self.kind, state, self.threads, self.ranks, **options)
        return make(state, self.threads, **options)

    def drive(self, run: Generator[Request, Answer, Result]) -> Result:
        """Carry out a run with one engine and return its result. Raises what the run or the engine raises."""
        requests = self.carry_out(run)
        while True:
            try:
                next(requests)
            except StopIteration as end:
                return end.value

    def carry_out(self, run: Generator[Request, Answer, Result]) -> Generator[None, None, Result]:
        """Carry out a run as `drive` does, but yield before each request, so that the caller may pause or end it."""
        engine: Engine | None = None
        owner = os.getpid()
        try:
            request = next(run)
            while True:
                try:
                    yield
                    require_owner(owner)
                    if engine is None:
                        assert isinstance(request, Load), "a run begins with Load"
                        engine = self(request.state)
                        answer: Answer = engine.abilities
                    else:
                        answer = answer_of(engine, request)
                except BaseException as error:  # lets the run close its files
                    request = run.throw(error)
                else:
                    request = run.send(answer)
        except StopIteration as end:
            return end.value
        except RuntimeError as error:
            if not isinstance(error.__cause__, StopIteration):
                raise
            *_, place = traceback.extract_tb(error.__cause__.__traceback__)
            where = f"{os.path.basename(place.filename)} line {place.lineno}, in {place.name}"
            raise InputError(f"{where}: StopIteration: give next() a default value") from error.__cause__

    @property
    def kind(self) -> type[Engine]:
        """Class of the engine."""
        return engine_class(self.name)

    @property
    def cores(self) -> int:
        """Number of cores that the engine uses."""
        return self.threads * self.ranks

    def require_grains(self, clumps: bool) -> None:
        """Raise InputError if the grains are clumps and the engine does not support them."""
        if clumps and not self.kind.abilities.clumps:
            able = [name for name in ENGINES if ENGINES[name].abilities.clumps]
            raise InputError("does not support clumps", field="engine", value=self.name, allowed=" or ".join(able))
        if clumps and self.ranks > 1:
            problem = "cannot share clumps, whose spheres may be on two ranks"
            raise InputError(problem, field="ranks", value=self.ranks, allowed="threads instead")

    def require_scene(self, scene: Scene) -> None:
        """Raise InputError if the engine does not support the scene or the precision."""
        abilities = self.kind.abilities
        abilities.require_scene(scene)
        if self.precision not in abilities.precisions:
            allowed = " or ".join(abilities.precisions)
            problem = f"is not available on the engine {self.name}"
            raise InputError(problem, field="precision", value=self.precision, allowed=allowed, quoted=True)


def answer_of(engine: Engine, request: Request) -> Answer:
    """Return the answer of an engine to a request."""
    match request:
        case Advance(steps, gradient):
            return engine.advance(steps, gradient)
        case Corrections():
            assert engine.abilities.follow is not None
            return engine.abilities.follow(engine, request)
        case Load(state):
            engine.load(state)
            return engine.abilities
        case _:
            return request(engine)


class Fused(Device):
    """labkit's own engine, on threads of this computer and on MPI ranks; `mixed` precision is faster."""

    def __init__(self, threads: int = 1, precision: Precision = "double", ranks: int = 1) -> None:
        """Store the number of threads of each rank, the precision of the forces, and the number of MPI ranks."""
        super().__init__("fused", threads, precision, ranks)


class Yade(Device):
    """YADE, the reference; it must be installed."""

    def __init__(self, threads: int = 1) -> None:
        """Store the number of threads."""
        super().__init__("yade", threads)


def device_of(engine: str | Device) -> Device:
    """Return an engine as an object; a name stands for the engine on one thread, or rank, in double precision.

    Raises InputError for an unknown name and for anything else.
    """
    if isinstance(engine, str):
        return Device(engine)
    if not isinstance(engine, Device):
        allowed = 'a name, such as "fused", or an object, such as labkit.Fused(threads=4)'
        raise InputError("is not an engine", field="engine", value=f"{engine!r:.80}", allowed=allowed)
    return engine
