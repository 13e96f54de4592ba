"""Writes the equations of the model in Fortran, derived from labkit.model.equations by labkit.model.derivation."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping

from labkit.model.code_writer import CodeWriter
from labkit.model.derivation import FLAG, INPUTS, SCALAR, SIX, Recording, Value
from labkit.model.differentials import derive_rates, derive_stress

TYPES = {SCALAR: "real(wp)", SIX: "real(wp), dimension(6)", FLAG: "logical"}
LONGEST = 118  # largest number of characters in a line


class FortranWriter(CodeWriter):
    """Lines of Fortran 2008 for the module of labkit_umat.f90, whose tensors are arrays."""

    constant = "c%{}"
    step = "  "
    functions: dict[str, str] = {  # noqa: RUF012 - a table
        "contract": "dot_product",
        "deviatoric_part": "deviator",
        "six_product": "symmetric_product",
    }

    def number(self, value: float) -> str:
        return f"{float(value)!r}_wp"

    def six(self, value: Value) -> str:
        return self.value(value)

    def choice(self, test: str, yes: str, no: str) -> str:
        simple = not re.search(r"[/*]", yes + no)  # merge evaluates both, even where one of them is undefined
        return f"merge({yes}, {no}, {test})" if simple else ""

    def branches(self, indent: str, test: str, yes: list[str], no: list[str]) -> list[str]:
        return [f"{indent}if ({test}) then", *yes, *([f"{indent}else", *no] if no else []), f"{indent}end if"]

    def declarations(self) -> list[str]:
        """Return the lines that declare the variables of all blocks written so far."""
        names = {kind: [name for name, type_of_name in self.kinds.items() if type_of_name == kind] for kind in TYPES}
        return [f"    {TYPES[kind]} :: {', '.join(listed)}" for kind, listed in names.items() if listed]


def equations() -> str:
    """Return the Fortran functions that replace the line !EQUATIONS in labkit_umat.f90."""
    functions = [_compression_line(), *_rates(), *_stress()]
    return "\n".join(line for function in functions for line in [*_wrap(function), ""])


STATE = ["    real(wp), intent(in) :: y(n_state)", "    real(wp) :: e, Z, Lam, A(6), F(6), Ft(6)"]
STRAIN = ["    real(wp), intent(in) :: D(6)", "    logical, intent(in) :: compressing"]
CHANGES = ["    real(wp) :: de, dZ, dLam, dA(6), dF(6), dFt(6)"]
CONSTANTS = ["    type(constants), intent(in) :: c"]


def _compression_line() -> list[str]:
    recording = Recording()
    e, c = recording.input("e"), recording.constants()
    writer = FortranWriter({"Z_com": recording.call("compression_coordination_number", e, c)})
    body = writer.block(recording.first, "    ")
    head = ["  !> Z^com", "  pure function z_compression(e, c) result(Z_com)", "    real(wp), intent(in) :: e"]
    return [*head, *CONSTANTS, *writer.declarations(), *body, "  end function z_compression"]


def _rates() -> tuple[list[str], list[str]]:
    first, rates, second, changes = derive_rates()
    writer = FortranWriter(rates)
    body = [*_read(), *writer.block(first, "    "), *_put(writer, rates, "v({})", "    ")]
    head = [
        "  !> C1 to C5: dy/dt for the strain rate D",
        "  pure function strain_driven(y, D, compressing, c) result(v)",
    ]
    head += [*STATE, *STRAIN, *CONSTANTS, "    real(wp) :: v(n_state)"]
    function = [*head, *writer.declarations(), *body, "  end function strain_driven"]
    writer = FortranWriter(changes)
    body = [*_read(), *writer.block(first, "    "), "    do k = 1, 6"]
    body += [*_read("      d", "S({}, k)"), "      dD = 0.0_wp", "      dD(k) = 1.0_wp"]
    body += [*writer.block(second, " " * 6), *_put(writer, changes, "out({}, k)", " " * 6), "    end do"]
    head = ["  !> Differentials of strain_driven for unit increments of D and changes S of y: columns of out"]
    head += ["  pure subroutine differentials(y, D, compressing, c, S, out)", *STATE, *STRAIN, *CONSTANTS, *CHANGES]
    head += ["    real(wp), intent(in) :: S(n_state, 6)", "    real(wp), intent(out) :: out(n_state, 6)"]
    head += ["    real(wp) :: dD(6)", "    integer :: k"]
    return function, [*head, *writer.declarations(), *body, "  end subroutine differentials"]


def _stress() -> tuple[list[str], list[str]]:
    first, stress, second, change = derive_stress()
    writer = FortranWriter(stress)
    body = [*_read(), *writer.block(first, "    ")]
    head = ["  !> C0 at the state y", "  pure function stress_of(y, c) result(sigma)", *STATE, *CONSTANTS]
    function = [*head, *writer.declarations(), *body, "  end function stress_of"]
    writer = FortranWriter(change)
    body = [*_read(), *_read("    d", "v({})"), *writer.block(first, "    "), *writer.block(second, "    ")]
    head = ["  !> Differential of C0 at y in the direction v", "  pure function stress_rate_of(y, v, c) result(dsigma)"]
    head += [*STATE, "    real(wp), intent(in) :: v(n_state)", *CHANGES, *CONSTANTS]
    return function, [*head, *writer.declarations(), *body, "  end function stress_rate_of"]


def _range(place: int) -> str:
    return str(place + 1) if place < 3 else f"{place + 1}:{place + 6}"


def _read(start: str = "    ", array: str = "y({})") -> list[str]:
    """Return the lines that read the state, or its change, from an array."""
    return [f"{start}{name} = {array.format(_range(place))}" for place, name in INPUTS.items()]


def _put(writer: FortranWriter, results: Mapping[str, Value], array: str, indent: str) -> list[str]:
    """Return the lines that write the results to an array."""
    pairs = zip(INPUTS, results.values(), strict=True)
    return [f"{indent}{array.format(_range(place))} = {writer.value(value)}" for place, value in pairs]


def _wrap(lines: Iterable[str]) -> list[str]:
    """Break lines at LONGEST characters, with the continuation character &."""
    wrapped = []
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()))
        parts = textwrap.wrap(line, LONGEST, subsequent_indent=indent + "  ", break_long_words=False)
        wrapped.append(" &\n".join(parts))
    return wrapped
