"""Compiles the kernel of one contact law: the loop over time steps and the stress, with that law's functions."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Hashable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from labkit.engines.kernel import contact, steps
from labkit.engines.kernel.compiling import (
    OPTIONS,
    Function,
    Untyped,
    Version,
    cache_on_disk,
    compile_callee,
    compile_with_callees,
    inline,
    names_of,
    stamp_of,
    with_globals,
)
from labkit.errors import InputError
from labkit.extensions import file_of
from labkit.grains.laws import vectors
from labkit.grains.laws.contact import BondHistory, Contact
from labkit.grains.laws.law import ContactLaw
from labkit.grains.scene import Scene
from labkit.servo import formula

HERE = Path(__file__).parent


class Kernel(NamedTuple):
    """The compiled functions of labkit.engines.kernel.steps.

    `advance` and `advance_threads` are steps.advance for one thread and for several; `branch_force` is
    steps.branch_force.
    """

    advance: Function
    advance_threads: Function
    branch_force: Function


def kernel_of(law: ContactLaw, single: bool = False) -> Kernel:
    """Return the Kernel of a contact law: compiled at its first call, or read from disk if no source has changed.

    Args:
        law: Contact law.
        single: True for mixed precision, in which the law is compiled in single precision.
    """
    return _compiled_kernel(cast(Hashable, type(law)), single)


@functools.cache
def _compiled_kernel(kind: type[ContactLaw], single: bool) -> Kernel:
    law = kind()
    if not law.labkits:
        try_out(law)
    version = Version(law.name + "_single" * single, single)
    double = Version(version.name)
    known: dict[Function, Function] = {}
    if single:
        known[vectors.inverse_root] = compile_with_callees(vectors.inverse_root_single, {}, version)
    names = {
        "pair": law.pair,
        "spring": law.normal.force,
        "attraction": law.cohesion.force,
        "bond_radius": law.bond.radius,
        "bond_stiffness": law.bond.stiffness,
        "overlap": contact.overlap_single if single else contact.overlap,
        **{name: getattr(contact, name) for name in ("load", "store", "transform", "dot", "length_and_inverse")},
    }
    names = {name: compile_with_callees(function, known, version) for name, function in names.items()}
    for name in ("history_rows", "load_bond", "store_bond", "link_force"):
        names[name] = inline(with_globals(getattr(contact, name), names, version))
    block_forces = compile_callee(with_globals(contact.block_forces, names, version))
    block_stress = compile_callee(with_globals(contact.block_stress, names, version))
    contacts = {"block_forces": block_forces, "SINGLE": single}
    domain_contacts = compile_callee(with_globals(steps.domain_contacts, contacts, double))
    stamp = _stamp(law, known)

    def loop(function: Function, name: str, names: dict[str, Function], **options: bool) -> Function:
        fresh = with_globals(function, names, double)
        fresh.__qualname__ = f"{name}_{version.name}"  # Numba's cache distinguishes functions by name
        return cache_on_disk(fresh, stamp, **OPTIONS, **options)

    branch_force = loop(steps.branch_force, "branch_force", {"block_stress": block_stress})
    names = {"domain_contacts": domain_contacts, "branch_force": branch_force}
    return Kernel(
        loop(steps.advance, "advance", names),
        loop(steps.advance, "advance_threads", names, parallel=True),
        branch_force,
    )


def was_compiled(law: ContactLaw, single: bool = False) -> bool:
    """Return True if this process or the cache on disk has a law's kernel, for some of the features of a scene."""
    advance = cast(Untyped, kernel_of(law, single).advance)
    file = getattr(getattr(advance, "_cache", None), "_cache_file", None)
    # private names of Numba, which another version may lack
    return bool(advance.signatures or getattr(file, "_load_index", dict)())


def try_out(law: ContactLaw) -> None:
    """Call `pair` of a user-defined law once as plain Python, so that errors in it give an ordinary traceback.

    Raises InputError if the result is not made of finite numbers.
    """
    branch, zero = vectors.Vector(1.6e-4, 0.0, 0.0), vectors.ZERO
    sliding = vectors.Vector(0.0, 1e-3, 0.0)
    touching = Contact(
        1e4, 8.5e-5, 8.5e-5, 1e-5, 1.0 / 1.6e-4, branch, vectors.Vector(1.0, 0.0, 0.0), sliding, zero, zero
    )
    *numbers, _ = law.features(Scene(law=law.name))
    result = law.pair(touching, zero, zero, 1e-7, True, *numbers, 0.0, BondHistory(0.0, zero, zero))
    if not np.isfinite(np.concatenate([np.ravel(part) for part in result[:-1]])).all():
        raise InputError(f"contact law {law.name}: its parts returned {result!r}: return finite numbers")


@contextlib.contextmanager
def explain_refusal(law: ContactLaw) -> Iterator[None]:
    """Raise InputError if Numba cannot compile a user-defined law that is valid Python."""
    try:
        yield
    except Exception as error:
        if law.labkits:
            raise
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
        raise InputError(
            f"contact law {law.name} cannot be compiled ({reason}): write its parts using only numbers and the "
            "functions of labkit.laws"
        ) from error


def _stamp(law: ContactLaw, known: Iterable[Function]) -> str | None:
    """Return a stamp of all sources of a kernel.

    It covers this package, the files of the law and of the functions `known` that it calls, and the constants that
    these import. It is None if a source has no file, as in a notebook, because a later version would look the same.
    """
    functions = set(known)
    files = {function.__code__.co_filename for function in functions}
    files |= {formula.__file__} | {file_of(kind) or "" for kind in type(law).__mro__ if issubclass(kind, ContactLaw)}
    if not all(Path(file).is_file() for file in files):
        return None
    constants = {
        f"{name} = {value!r}"
        for function in functions
        for name, value in names_of(function).items()
        if isinstance(value, (bool, int, float, tuple))
    }
    return "\n".join([stamp_of([*HERE.glob("*.py"), *map(Path, files)]), *sorted(constants)])
