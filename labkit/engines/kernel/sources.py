"""The functions of a contact law, a trial call of user-defined laws, and stamps of the sources of a law."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from labkit.engines.kernel.frozen import PLAIN, Function, all_functions, describe
from labkit.engines.kernel.machine import hash_files
from labkit.errors import InputError
from labkit.extensions import file_of, is_labkits
from labkit.grains.laws import vectors
from labkit.grains.laws.contact import Contact, Values
from labkit.grains.laws.law import ContactLaw
from labkit.grains.laws.pair import Composition
from labkit.grains.scene import Scene
from labkit.micro import stress
from labkit.servo import formula

HERE = Path(__file__).parent


def functions_of(composition: Composition) -> dict[str, Function]:
    """Return the functions of a law by their names in labkit.engines.kernel.contact_block."""
    return {"pair": composition.pair, "normal_force": composition.normal_force}


def try_out(law: ContactLaw) -> None:
    """Call `pair` of a user-defined law once as plain Python, so that errors in it give an ordinary traceback.

    Raises InputError if the result contains other values than finite numbers.
    """
    scene = Scene(law=law.name)
    composition = law.composition(scene)
    branch, zero = vectors.Vector(1.6e-4, 0.0, 0.0), vectors.ZERO
    sliding = vectors.Vector(0.0, 1e-3, 0.0)
    touching = Contact(
        1e4, 8.5e-5, 8.5e-5, 1e-5, 1.0 / 1.6e-4, branch, vectors.Vector(1.0, 0.0, 0.0), sliding, zero, zero
    )
    history = composition.make_history(*(zero if column.size > 1 else 0.0 for column in composition.columns.values()))
    numbers = law.numbers(scene)
    result = composition.pair(touching, history, numbers, 1e-7)
    if not np.isfinite(
        np.concatenate([np.ravel(value) for value in (*result[:3], *result.history, *result.losses)])
    ).all():
        raise InputError(f"contact law {law.name}: its parts returned {result!r}: return finite numbers")
    _require_potential(law, composition, numbers)


def _require_potential(law: ContactLaw, composition: Composition, numbers: Values) -> None:
    """Raise InputError if the normal force of user-defined parts is not the derivative of their energy."""
    radius, normal = 8.5e-5, vectors.Vector(1.0, 0.0, 0.0)
    for overlap in (*((-1e-5, -1e-7) if law.far else ()), 1e-7, 1e-6, 1e-5):
        begun = law.history_at(np.array([overlap]), {})
        history = composition.make_history(
            *(
                vectors.ZERO if column.size > 1 else float(begun[name][0])
                for name, column in composition.columns.items()
            )
        )
        step, force, energy = 1e-5 * abs(overlap), 0.0, []
        for depth in (overlap - 2.0 * step, overlap - step, overlap):
            contact = Contact(1e4, radius, radius, depth, 0.0, vectors.ZERO, normal, *(vectors.ZERO,) * 3)
            energy.append(float(composition.stored_energy(contact, history, numbers)))
            force = force if depth == overlap else float(composition.normal_force(contact, history, numbers))
        slope = (energy[2] - energy[0]) / (2.0 * step)
        if not abs(slope - force) <= 1e-6 * max(abs(force), abs(slope)) + 1e-12:
            raise InputError(
                f"contact law {law.name}: the normal_force of its parts is not the derivative of their stored_energy "
                f"({force:.6g} N against {slope:.6g} N at an overlap of {overlap:.3g} m)"
            )


@contextlib.contextmanager
def explain_refusal(law: ContactLaw) -> Iterator[None]:
    """Raise InputError if Numba cannot compile a user-defined law that is valid Python, or its code may fail."""
    try:
        yield
    except Exception as error:
        if law.labkits or isinstance(error, InputError):
            raise
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
        raise InputError(
            f"contact law {law.name} cannot be compiled ({reason}): write its parts using only numbers and the "
            "functions of labkit.laws"
        ) from error


def code_of_law(scene: Scene) -> str:
    """Return a hash of the code and the values of the scene's contact law, without comments; empty for labkit's laws.

    It is also empty if a value cannot be described, because the hash would differ in the next process.
    """
    law = scene.contact_law
    if law.labkits:
        return ""
    frozen = describe(*functions_of(law.composition(scene)).values())
    text = frozen.text.replace(type(law).__module__, "")
    for kind in dict.fromkeys(kind for part in law.parts_by_kind.values() for kind in type(part).__mro__):
        for method in filter(inspect.isfunction, [] if is_labkits(kind) else vars(kind).values()):
            code, plain = method.__code__, [value for value in method.__code__.co_consts if type(value) in PLAIN]
            text += f"{method.__name__} {code.co_code.hex()} {code.co_names} {plain}"
    return hashlib.sha256(text.encode()).hexdigest() * frozen.complete


def stamp_of(law: ContactLaw | None = None, composition: Composition | None = None) -> str | None:
    """Return a stamp of all sources of a law, or of the functions that all laws share.

    The stamp covers this package, the files of the law and of the functions that it calls, and all values that these
    functions use. It is None if a source has no file, as in a notebook, or if a value cannot be described, because
    changes would go unnoticed.
    """
    files = {*map(str, HERE.glob("*.py")), vectors.__file__, formula.__file__, stress.__file__}
    used, complete = list[str](), True
    if law is not None and composition is not None:
        parts = functions_of(composition)
        functions = list(all_functions(*parts.values()))
        files |= {function.__code__.co_filename for function in functions}
        files |= {file_of(kind) or "" for kind in type(law).__mro__ if issubclass(kind, ContactLaw)}
        frozen = describe(*parts.values())
        used, complete = [frozen.text], frozen.complete
    if not complete or not all(Path(file).is_file() for file in files):
        return None
    return "\n".join([hash_files(files), *used])
