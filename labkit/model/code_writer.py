"""Writes recorded terms (labkit.model.derivation) as lines of Python; a subclass writes another language."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

from labkit.model.derivation import FLAG, SIX, Branch, Term, Value

PRECEDENCE = {">": 0, "+": 1, "-": 1, "negative": 1, "*": 2, "/": 2, "**": 4}
ATOM = 5
SHORT = 40  # an expression used only once is written inline, up to this length


class CodeWriter:
    """Lines of Python for the functions that Numba compiles; terms on which no result depends are left out."""

    constant = "c.{}"
    step = "    "  # indentation of a block
    functions: dict[str, str] = {"exp": "np.exp"}  # noqa: RUF012 - a table

    def __init__(self, results: Mapping[str, Value]) -> None:
        """Find the terms that the results (name -> term) need, and count how often each is used."""
        self._uses = Counter[Term]()
        self._names: dict[Term, str] = {}
        self.kinds: dict[str, str] = {}  # variable -> kind, for every variable written
        self._taken: set[str] = set()
        for name, value in results.items():
            if isinstance(value, Term):
                value.name = name
            self._use(value, None)

    def _use(self, value: Value, block: Branch | None) -> None:
        if not isinstance(value, Term):
            return
        uses = self._uses[value]
        self._uses[value] += 1 if block is value.block else 2  # counted twice: never written inline in another block
        if uses:
            return
        if value.operation == "choose":
            condition, *branches = value.operands
            self._use(condition, value.block)
            for inner, result in branches:
                self._use(result, inner)
        else:
            for operand in value.operands:
                self._use(operand, value.block)

    def block(self, block: Branch, indent: str) -> list[str]:
        """Return the lines that assign those terms of a block that are not written inline."""
        lines = []
        for term in block:
            if term.operation == "choose":
                lines += self._choice(term, indent)
            elif self._uses[term] > 1 or (self._uses[term] and len(self._operation(term)[0]) > SHORT):
                lines.append(f"{indent}{self._assign(term)} = {self._operation(term)[0]}")
        return lines

    def value(self, value: Value, needed: int = 0) -> str:
        """Return the text of a term or number, in parentheses if its precedence is below `needed`."""
        text, precedence = self._text(value)
        return text if precedence >= needed else f"({text})"

    def number(self, value: float) -> str:
        """Return the text of a number."""
        return repr(float(value))

    def six(self, value: Value) -> str:
        """Return the text of a tensor, or of the number 0."""
        return "ZERO" if isinstance(value, float) else self.value(value)

    def _text(self, value: Value) -> tuple[str, int]:
        if not isinstance(value, Term):
            return self.number(value), ATOM if value >= 0 else PRECEDENCE["negative"]
        if value.operation == "constant":
            return self.constant.format(*value.operands), ATOM
        if value.operation == "input":
            return value.name, ATOM
        if value in self._names:
            return self._names[value], ATOM
        return self._operation(value)

    def _operation(self, term: Term) -> tuple[str, int]:
        operation, operands = term.operation, term.operands
        if operation not in PRECEDENCE:
            name = self.functions.get(operation, operation)
            return f"{name}({', '.join(self.value(x) for x in operands)})", ATOM
        precedence = PRECEDENCE[operation]
        if operation == "negative":
            return f"-{self.value(operands[0], precedence + 1)}", precedence
        left, right = (precedence + 1, precedence) if operation == "**" else (precedence, precedence + 1)
        space = "" if operation == "**" else " "
        return f"{self.value(operands[0], left)}{space}{operation}{space}{self.value(operands[1], right)}", precedence

    def _assign(self, term: Term) -> str:
        wished = term.name or {SIX: "T1", FLAG: "flag"}.get(term.kind, "s1")
        name, count = wished, 1
        while name.lower() in self._taken:
            count += 1
            name = f"{wished.rstrip('1') if not term.name else wished + '_'}{count}"
        self._taken.add(name.lower())
        self._names[term], self.kinds[name] = name, term.kind
        return name

    def _choice(self, term: Term, indent: str) -> list[str]:
        """Return the lines of a choice; if only terms inside its branches are needed, omit its result."""
        condition, *branches = term.operands
        bodies = [self.block(inner, indent + self.step) for inner, _ in branches]
        if not self._uses[term]:
            return self.branches(indent, self.value(condition), *bodies) if any(bodies) else []
        test = self.value(condition)
        write: Callable[[Value], str] = self.six if term.kind == SIX else self.value
        results = [write(result) for _, result in branches]
        name = self._assign(term)
        if not any(bodies) and (short := self.choice(test, *results)):
            return [f"{indent}{name} = {short}"]
        yes, no = (
            [*body, f"{indent}{self.step}{name} = {result}"] for body, result in zip(bodies, results, strict=True)
        )
        return self.branches(indent, test, yes, no)

    def choice(self, test: str, yes: str, no: str) -> str:
        """Return a conditional expression for `yes` or `no`; empty if only two branches can express it."""
        return f"{yes} if {test} else {no}"

    def branches(self, indent: str, test: str, yes: list[str], no: list[str]) -> list[str]:
        """Return the lines of a condition with its two branches."""
        return [f"{indent}if {test}:", *(yes or [f"{indent}    pass"]), *([f"{indent}else:", *no] if no else [])]
