"""The kernel of one contact law: loop over time steps and sum of the stress, compiled with that law's functions."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from labkit.dem.laws import vectors
from labkit.dem.laws.base import Contact, ContactLaw, Response
from labkit.dem.scene import Scene
from labkit.engines.kernel import contact, steps
from labkit.engines.kernel.compiling import (
    OPTIONS,
    Version,
    cached,
    compiled,
    compiled_with_callees,
    stamp_of,
    with_globals,
)
from labkit.errors import InputError
from labkit.extensions import file_of

HERE = Path(__file__).parent


class Kernel(NamedTuple):
    """The compiled functions of labkit.engines.kernel.steps.

    advance, advance_threads: steps.advance for one thread and for several; branch_force: steps.branch_force.
    """

    advance: Callable[..., Any]
    advance_threads: Callable[..., Any]
    branch_force: Callable[..., Any]


def kernel_of(law: ContactLaw, single: bool = False) -> Kernel:
    """Return the Kernel of a contact law: compiled at its first call, or read from disk if no source has changed.

    single: True for mixed precision, in which the law is compiled in single precision. Laws that inherit both `pair`
    and `spring` share the kernel of the law that defines them.
    """
    return _compiled_kernel(next(kind for kind in type(law).__mro__ if {"pair", "spring"} & set(vars(kind))), single)


@functools.cache
def _compiled_kernel(kind: type[ContactLaw], single: bool) -> Kernel:
    law = kind()
    if not law.labkits:
        try_out(law)
    version = Version(law.name + "_single" * single, single)
    double = Version(version.name)
    known: dict[Any, Any] = {}
    if single:
        known[vectors.inverse_root] = compiled_with_callees(vectors.inverse_root_single, {}, version)
    pair, spring = (compiled_with_callees(function, known, version) for function in (law.pair, law.spring))
    overlap = compiled_with_callees(contact.overlap_single if single else contact.overlap, known, version)
    names = {**_compiled_functions(contact, known, version), "pair": pair, "spring": spring, "overlap": overlap}
    block_forces = compiled(with_globals(contact.block_forces, names, version))
    block_stress = compiled(with_globals(contact.block_stress, names, version))
    contacts = {"block_forces": block_forces, "SINGLE": single}
    domain_contacts = compiled(with_globals(steps.domain_contacts, contacts, double))
    stamp = _stamp(law, known)

    def loop(function: Callable[..., Any], name: str, names: dict[str, Any], **options: Any) -> Any:
        fresh = with_globals(function, names, double)
        fresh.__qualname__ = f"{name}_{version.name}"  # Numba's cache distinguishes functions by name
        return cached(fresh, stamp, **OPTIONS, **options)

    return Kernel(
        loop(steps.advance, "advance", {"domain_contacts": domain_contacts}),
        loop(steps.advance, "advance_threads", {"domain_contacts": domain_contacts}, parallel=True),
        loop(steps.branch_force, "branch_force", {"block_stress": block_stress}),
    )


def try_out(law: ContactLaw) -> None:
    """Call `pair` of a user-defined law once as plain Python, so that errors in it give an ordinary traceback.

    Raises InputError if the result is not a Response of finite numbers.
    """
    features = law.features(Scene(law=law.name))
    branch, zero = (1.6e-4, 0.0, 0.0), (0.0, 0.0, 0.0)
    touching = Contact(1e4, 8.5e-5, 8.5e-5, 1e-5, 1.0 / 1.6e-4, branch, (1.0, 0.0, 0.0), (0.0, 1e-3, 0.0), zero, zero)
    arguments = features.constants, features.friction, features.rolling, features.dashpots
    result = law.pair(touching, zero, zero, 1e-7, *arguments, True)
    numbers = (
        np.concatenate([np.ravel(part) for part in result]) if isinstance(result, Response) else np.full(1, np.nan)
    )
    if numbers.size != 18 or not np.isfinite(numbers).all():
        raise InputError(f"contact law {law.name}: pair returned {result!r}: return a Response of finite numbers")


def _compiled_functions(module: Any, known: dict[Any, Any], version: Version) -> dict[str, Any]:
    """Compile the plain Python helpers that a module uses: name -> function."""
    helpers = {**vars(vectors), "load": module.load, "store": module.store, "stretched": module.stretched}
    return {name: compiled_with_callees(f, known, version) for name, f in helpers.items() if inspect.isfunction(f)}


def _stamp(law: ContactLaw, known: Iterable[Callable[..., Any]]) -> str | None:
    """Return a stamp of all sources of a kernel.

    It covers this package, the files of the law and of the functions `known` that it calls, and the constants that
    these import. None if a source has no file, as in a notebook, because a later version could not be distinguished.
    """
    functions = set(known)
    files = {function.__code__.co_filename for function in functions}
    files |= {file_of(kind) or "" for kind in type(law).__mro__ if issubclass(kind, ContactLaw)}
    if not all(Path(file).is_file() for file in files):
        return None
    constants = {
        f"{name} = {function.__globals__[name]!r}"
        for function in functions
        for name in function.__code__.co_names
        if isinstance(function.__globals__.get(name), (bool, int, float, tuple))
    }
    return "\n".join([stamp_of([*HERE.glob("*.py"), *map(Path, files)]), *sorted(constants)])
