"""Derives code from the equations: their formulas, and the differentials of these formulas in any direction.

The functions of labkit.model.equations are run once with symbols instead of numbers, and every operation is recorded as
a Term. `Differentials` adds the differentials by forward differentiation; terms that depend on the state alone are
computed once, before the loop over directions. A CodeWriter turns terms into Python, which labkit.model.differentials
compiles, or into Fortran, which becomes the user material (labkit.plugins.umat.fortran).
"""

from __future__ import annotations
import __future__

import ast
import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from labkit.model.constants import Constants
from labkit.model.equations import StateVariables
from labkit.sff import c0

SCALAR, SIX, FLAG = "scalar", "six", "flag"  # kinds of terms
INPUTS = {0: "e", 1: "Z", 2: "Lam", 3: "A", 9: "F", 15: "Ft"}  # index in the state vector -> name
Value = Any  # a Term, or a number that Python has already computed


@dataclasses.dataclass(eq=False)
class Term:
    """A recorded operation, or an input; `name` is the variable that holds it."""

    recording: Recording
    kind: str
    operation: str
    operands: tuple[Value, ...]
    block: Branch
    name: str = ""

    def _with(self, operation: str, other: Value, swapped: bool = False) -> Value:
        operands = (other, self) if swapped else (self, other)
        kind = SIX if SIX in (self.kind, getattr(other, "kind", SCALAR)) else SCALAR
        return self.recording.record(kind, operation, *operands)

    __add__ = functools.partialmethod(_with, "+")
    __radd__ = functools.partialmethod(_with, "+", swapped=True)
    __sub__ = functools.partialmethod(_with, "-")
    __rsub__ = functools.partialmethod(_with, "-", swapped=True)
    __rmul__ = functools.partialmethod(_with, "*", swapped=True)
    __rtruediv__ = functools.partialmethod(_with, "/", swapped=True)
    __pow__ = functools.partialmethod(_with, "**")

    def __mul__(self, other: Value) -> Value:
        swapped = self.kind == SIX and getattr(other, "kind", SCALAR) != SIX  # the number comes first
        return self._with("*", other, swapped)

    def __truediv__(self, other: Value) -> Value:
        return self * (1.0 / other) if self.kind == SIX else self._with("/", other)

    def __neg__(self) -> Value:
        return -1.0 * self if self.kind == SIX else self.recording.record(SCALAR, "negative", self)

    def __abs__(self) -> Value:
        return self.recording.record(SCALAR, "abs", self)

    def __gt__(self, other: Value) -> Value:
        return self.recording.record(FLAG, ">", self, other)


class Branch(list[Term]):
    """A block of terms in the order of their computation; `parent` is the enclosing block, if any."""

    def __init__(self, parent: Branch | None = None) -> None:
        """Begin an empty block."""
        super().__init__()
        self.parent = parent
        self.known: dict[tuple[object, ...], Value] = {}

    def find(self, key: tuple[object, ...]) -> Value:
        """Return the value recorded for this key in this block or an enclosing block, or None."""
        if key in self.known or self.parent is None:
            return self.known.get(key)
        return self.parent.find(key)


class Recording:
    """Records the equations as terms; `call` runs one of their functions, by name, with terms as arguments."""

    def __init__(self) -> None:
        """Compile the equations with recording functions in place of numerical functions."""
        self.block = self.first = Branch()
        self._functions: dict[str, Value] = {
            "np": SimpleNamespace(exp=self._unary("exp"), sqrt=math.sqrt, maximum=self._maximum),
            "StateVariables": StateVariables,
            "IDENTITY": self.input("identity", SIX),
            "choose": self.choose,
            "contract": lambda S, T: self.record(SCALAR, "contract", S, T),
            "norm": lambda T: self.record(SCALAR, "norm", T),
            "trace": lambda T: self.record(SCALAR, "trace", T),
            "deviatoric_part": lambda T: self.record(SIX, "deviatoric_part", T),
            "six_product": lambda S, T: self.record(SIX, "six_product", S, T),
            "six_at": lambda y, start: y[start],
        }
        for name, function in _equations(self._functions).items():
            self._functions[name] = self._name_results(name, function)
        product, contract = self._functions["six_product"], self._functions["contract"]
        self._functions["six_bracket"] = lambda A, F, Ft: c0.bracket(  # here for whole tensors, not for one component
            self._functions["IDENTITY"], A, F, contract(F, A), product(F, A), Ft
        )

    def call(self, name: str, *arguments: Value) -> Value:
        """Record a call of a function of labkit.model.equations; returns its result as terms."""
        return self._functions[name](*arguments)

    def input(self, name: str, kind: str = SCALAR) -> Term:
        """Return a term that stands for an argument of the generated function."""
        return Term(self, kind, "input", (), self.first, name)

    def state(self, prefix: str = "") -> dict[int, Term]:
        """Return input terms for the state, index in the state vector -> term."""
        return {place: self.input(prefix + name, SIX if place > 2 else SCALAR) for place, name in INPUTS.items()}

    def constants(self) -> Constants:
        """Return labkit.model.constants.Constants with a term in each field."""
        kinds = {name: FLAG if kind == "bool" else SCALAR for name, kind in Constants.__annotations__.items()}
        terms: dict[str, Value] = {
            name: Term(self, kind, "constant", (name,), self.first) for name, kind in kinds.items()
        }
        return Constants(**terms)

    def record(self, kind: str, operation: str, *operands: Value) -> Value:
        """Return the term of an operation; an operation that was already recorded is not recorded again."""
        if operation == "*" and operands[0] == 1.0:
            return operands[1]
        key = (operation, *operands)
        term = self.block.find(key)
        if term is None:
            term = self.block.known[key] = Term(self, kind, operation, operands, self.block)
            self.block.append(term)
        return term

    def choose(self, condition: Value, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        """Record `yes() if condition else no()`; each branch is a separate block."""
        if not isinstance(condition, Term):
            return yes() if condition else no()
        branches = []
        for branch in (yes, no):
            with self.inside(Branch(self.block)) as block:
                branches.append((block, branch()))
        kind = SIX if any(isinstance(x, Term) and x.kind == SIX for _, x in branches) else SCALAR
        term = Term(self, kind, "choose", (condition, *branches), self.block)
        self.block.append(term)
        return term

    @contextlib.contextmanager
    def inside(self, block: Branch) -> Iterator[Branch]:
        """Record into this block inside a `with` statement."""
        around, self.block = self.block, block
        try:
            yield block
        finally:
            self.block = around

    def _unary(self, operation: str) -> Callable[[Value], Value]:
        plain = getattr(math, operation)
        return lambda x: self.record(SCALAR, operation, x) if isinstance(x, Term) else plain(x)

    def _maximum(self, a: Value, b: Value) -> Value:
        return self.choose(a > b, lambda: a, lambda: b)

    def _name_results(self, name: str, function: Callable[..., Value]) -> Callable[..., Value]:
        """Wrap a function: name its result after the function, and run it only once for the same arguments."""

        def call(*arguments: Value) -> Value:
            key = (name, *(id(x) if isinstance(x, dict) else x for x in arguments))
            term = self.block.find(key)
            if term is None:
                term = self.block.known[key] = function(*arguments)
            if isinstance(term, Term) and not term.name and term.operation != "constant":
                term.name = name
            return term

        return call


class _Branches(ast.NodeTransformer):
    """`a if b else c` becomes choose(b, lambda: a, lambda: c), so that both branches can be recorded."""

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        nothing = ast.arguments([], [], None, [], [], None, [])
        branches: list[ast.expr] = [ast.Lambda(nothing, branch) for branch in (node.body, node.orelse)]
        return ast.Call(ast.Name("choose", ast.Load()), [node.test, *branches], [])


def _equations(functions: dict[str, Value]) -> dict[str, Callable[..., Value]]:
    """Return the functions of labkit.model.equations, name -> function; they call `functions`, not compiled code."""
    file = Path(__file__).with_name("equations.py")
    tree = _Branches().visit(ast.parse(file.read_text(encoding="utf-8")))
    statements: list[ast.stmt] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            node.decorator_list = []
            statements.append(node)
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]).isupper():
            statements.append(node)
    module = ast.fix_missing_locations(ast.Module(statements, []))
    exec(compile(module, str(file), "exec", __future__.annotations.compiler_flag), functions)
    return {node.name: functions[node.name] for node in statements if isinstance(node, ast.FunctionDef)}


class Differentials:
    """Differentials of terms in the direction given by the differentials of the inputs; `block` contains them."""

    def __init__(self, recording: Recording, seeds: dict[Term, Term]) -> None:
        """Differentiate every recorded term; `given` maps each input to its differential."""
        self.recording, self.known = recording, dict[Term, Value](seeds)
        with recording.inside(Branch()) as self.block:
            self._add(recording.first)

    def of(self, x: Value) -> Value:
        """Return the differential of a term; the number 0 if the term does not depend on the inputs."""
        return self.known.get(x, 0.0) if isinstance(x, Term) else 0.0

    def _add(self, block: Branch) -> None:
        for term in list(block):
            differential = self._differential(term, block)
            if isinstance(differential, Term):
                self.known[term] = differential
                if term.name and not differential.name and differential.operation != "input":
                    differential.name = "d" + term.name

    def _once(self, block: Branch, compute: Callable[[], Value]) -> Value:
        """Compute a factor that does not depend on the direction in the block of its term, outside the loop."""
        with self.recording.inside(block):
            return compute()

    def _positive(self, block: Branch, condition: Value, compute: Callable[[], Value]) -> Value:
        return self._once(block, lambda: self.recording.choose(condition > 0.0, compute, lambda: 0.0))

    def _differential(self, term: Term, block: Branch) -> Value:
        operation, operands = term.operation, term.operands
        if operation == "choose":
            return self._of_choice(*operands)
        changes = [self.of(x) for x in operands]
        if not any(isinstance(x, Term) for x in changes) or term.kind == FLAG:
            return 0.0
        a, da = operands[0], changes[0]
        if operation in ("trace", "deviatoric_part"):
            return self.recording.record(term.kind, operation, da)
        if operation == "negative":
            return -da
        if operation == "exp":
            return term * da
        if operation == "norm":
            return self._positive(block, term, lambda: 1.0 / term) * self.recording.record(SCALAR, "contract", a, da)
        if operation == "abs":
            return self._once(block, lambda: self.recording.choose(a > 0.0, lambda: 1.0, lambda: -1.0)) * da
        b, db = operands[1], changes[1]
        if operation == "+":
            return _sum(da, db)
        if operation == "-":
            return da - db if _terms(da, db) else _sum(da, -db)
        if operation == "**":
            if isinstance(db, Term):
                raise NotImplementedError(f"an exponent that depends on the state: {term.name}")
            return self._positive(block, a, lambda: b * term / a) * da
        if operation == "/":
            inverse = self._once(block, lambda: 1.0 / b)
            quotient = self._once(block, lambda: -term * inverse) if isinstance(db, Term) else 0.0
            return _sum(_product(da, inverse), _product(quotient, db))
        if operation == "*":
            return _sum(_product(da, b), _product(a, db))
        parts = [self.recording.record(term.kind, operation, x, y) for x, y in ((da, b), (a, db)) if _terms(x, y)]
        return 2.0 * parts[0] if a is b else _sum(*parts, 0.0)

    def _of_choice(self, condition: Value, *branches: tuple[Branch, Value]) -> Value:
        differentials = []
        for block, value in branches:
            with self.recording.inside(Branch(self.recording.block)) as changes:
                self._add(block)
            differentials.append((changes, self.of(value)))
        kinds = {x.kind for _, x in differentials if isinstance(x, Term)}
        if not kinds:
            return 0.0
        term = Term(self.recording, kinds.pop(), "choose", (condition, *differentials), self.recording.block)
        self.recording.block.append(term)
        return term


def _terms(*values: Value) -> bool:
    return all(isinstance(x, Term) for x in values)


def _product(x: Value, y: Value) -> Value:
    return x * y if (isinstance(x, Term) and y != 0.0) or (isinstance(y, Term) and x != 0.0) else 0.0


def _sum(x: Value, y: Value, *_: Value) -> Value:
    return y if not isinstance(x, Term) else (x if not isinstance(y, Term) else x + y)
