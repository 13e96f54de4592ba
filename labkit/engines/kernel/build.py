"""A kernel for one contact law: the loop over steps and the sum of stresses, compiled with that law's functions."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from labkit.dem.laws import base, vectors
from labkit.dem.laws.base import ContactLaw
from labkit.engines.kernel import contact, steps
from labkit.engines.kernel.compiling import OPTIONS, cached, compiled, compiled_with_callees, stamp_of, with_globals

HERE = Path(__file__).parent


class Kernel(NamedTuple):
    """advance, advance_threads: labkit.engines.kernel.steps.advance on one thread and on several; branch_force."""

    advance: Callable[..., Any]
    advance_threads: Callable[..., Any]
    branch_force: Callable[..., Any]


@functools.cache
def kernel_of(law: ContactLaw) -> Kernel:
    """The Kernel of a contact law: compiled at its first step, or read from the disk if its sources are the same."""
    known: dict[Any, Any] = {}
    pair, spring = compiled_with_callees(law.pair, known), compiled_with_callees(law.spring, known)
    names = {**_compiled_functions(contact, known), "pair": pair, "spring": spring}
    block_forces = compiled(with_globals(contact.block_forces, names))
    block_stress = compiled(with_globals(contact.block_stress, names))
    domain_contacts = compiled(with_globals(steps.domain_contacts, {"block_forces": block_forces}))
    stamp = stamp_of(_sources(law))

    def loop(function: Callable[..., Any], name: str, names: dict[str, Any], **options: Any) -> Any:
        fresh = with_globals(function, names)
        fresh.__qualname__ = f"{name}_{law.name}"  # Numba's cache tells functions apart by their names
        return cached(fresh, stamp, **OPTIONS, **options)

    contacts = {"domain_contacts": domain_contacts}
    return Kernel(
        loop(steps.advance, "advance", contacts),
        loop(steps.advance, "advance_threads", contacts, parallel=True),
        loop(steps.branch_force, "branch_force", {"block_stress": block_stress}),
    )


def _compiled_functions(module: Any, known: dict[Any, Any]) -> dict[str, Any]:
    """The plain helpers of a module, compiled: name -> function."""
    helpers = {**vars(vectors), "load": module.load, "store": module.store, "stretched": module.stretched}
    return {name: compiled_with_callees(f, known) for name, f in helpers.items() if inspect.isfunction(f)}


def _sources(law: ContactLaw) -> list[Path]:
    """The files that a kernel is made of: this room, and those of the law."""
    modules = {inspect.getmodule(kind) for kind in type(law).__mro__ if issubclass(kind, ContactLaw)} | {base, vectors}
    return [*HERE.glob("*.py"), *(Path(module.__file__) for module in modules if module and module.__file__)]
