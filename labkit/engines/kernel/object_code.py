"""Object code of a C function that Numba compiled: code that runs without Numba and without Python, and cannot fail.

Numba's C function calls the compiled function and reports its exceptions to Python. The host calls C functions without
Python, so nothing could report an exception. Here LLVM proves that the function raises none, and removes the reports.
A function that may raise an exception, or that needs more than arithmetic, is refused.
"""

from __future__ import annotations

import re
from typing import Any

import llvmlite.binding as llvm

NAMES = (
    *("a?(sin|cos|tan)h?", "atan2", "exp(2|m1)?", "log(2|10|1p)?", "pow", "sqrt", "cbrt", "hypot", "fmod", "fabs"),
    *(
        "floor",
        "ceil",
        "trunc",
        "round",
        "rint",
        "nearbyint",
        "fmin",
        "fmax",
        "copysign",
        "ldexp",
        "erfc?",
        "[lt]gamma",
    ),
)
ARITHMETIC = re.compile(
    rf"llvm\..*|mem(cpy|move|set)|({'|'.join(NAMES)})f?"
)  # functions of LLVM, of C and of its math.h


class MayFail(Exception):
    """The code of a function may fail, or needs more than arithmetic; the message says why."""


def emit_object(text: str, wrapper: str, name: str, machine: Any) -> bytes:
    """Return the object code of a C function. Raises MayFail.

    Args:
        text: Optimised LLVM code from Numba.
        wrapper: Name of the C function in this code.
        name: Name of the C function in the object code, its only symbol.
        machine: LLVM's code generator.
    """
    module = llvm.parse_assembly(text if machine.triple in text else retarget(text, machine))
    only_visible(module, wrapper, name)
    remove_reports(module, machine)
    if needed_by(module):
        raise MayFail(
            "it allocates memory (an array, list, dict or text), prints, or may raise an exception (raise, assert, or "
            "an index that may be out of range)"
        )
    return bytes(machine.emit_object(module))


def retarget(text: str, machine: Any) -> str:
    """Return LLVM code that Numba wrote for this computer as code for the computer of a code generator."""
    for name, value in (("triple", machine.triple), ("datalayout", machine.target_data)):
        text = re.sub(rf"^target {name} = .*$", f'target {name} = "{value}"', text, flags=re.MULTILINE)
    return re.sub(r'"(target-cpu|target-features|tune-cpu)"="[^"]*"', "", text)


def only_visible(module: Any, wrapper: str, name: str) -> None:
    """Rename a function, and hide all others from the linker, so that LLVM sees all their calls."""
    for item in (*module.functions, *module.global_variables):
        if item.name != wrapper and not item.is_declaration:
            item.linkage = llvm.Linkage.internal
    module.get_function(wrapper).name = name


def remove_reports(module: Any, machine: Any) -> None:
    """Remove the reports of exceptions that LLVM proves never to occur, then all that nothing calls.

    Interprocedural constant propagation finds that the status of the compiled function is always 0.
    """
    passes = llvm.create_new_module_pass_manager()
    passes.add_ipsccp_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    module.verify()


def needed_by(module: Any) -> list[str]:
    """Return the names of functions and variables outside a module that it needs, other than those of arithmetic."""
    outside = [item.name for item in (*module.functions, *module.global_variables) if item.is_declaration]
    return [name for name in outside if not ARITHMETIC.fullmatch(name)]
