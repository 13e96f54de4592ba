"""Parsed source code for the tests of house rules: files, functions, classes and imports."""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

from labkit.lazy import exports

ROOT = Path(__file__).resolve().parents[2]
LABKIT = ROOT / "labkit"
DOOR = exports(LABKIT / "__init__.py")  # public name -> (module, name there)
CONSTRUCTORS = {"__init__", "__post_init__", "__call__"}  # dunder methods that count as public

OWNERS = {"self", "cls"}
DOCUMENTED = {"_asdict", "_fields", "_replace", "_exit"}  # by Python, for named tuples and os

Function = ast.FunctionDef | ast.AsyncFunctionDef


def files(*folders: str) -> list[Path]:
    """All Python files in the given folders of the repository."""
    return sorted(file for folder in folders for file in (ROOT / folder).rglob("*.py"))


@functools.cache
def tree(file: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(file.read_text(), str(file))


def name_of(file: Path) -> str:
    """Path of a file relative to the repository, for messages and names of tests."""
    return str(file.relative_to(ROOT))


def is_public(name: str) -> bool:
    """True if a function, method or class is public."""
    return not name.startswith("_") or name in CONSTRUCTORS


@dataclasses.dataclass(frozen=True)
class Public:
    """A public function or class, or a public method of a public class (`owner`)."""

    file: Path
    node: Function | ast.ClassDef
    owner: ast.ClassDef | None = None

    def __str__(self) -> str:
        owner = f"{self.owner.name}." if self.owner else ""
        return f"{name_of(self.file)}:{self.node.lineno} {owner}{self.node.name}"

    @property
    def decorators(self) -> list[str]:
        """Names of the decorators without arguments; `overload` for `@typing.overload`."""
        plain = [node for node in self.node.decorator_list if isinstance(node, ast.Name | ast.Attribute)]
        return [node.id if isinstance(node, ast.Name) else node.attr for node in plain]

    @property
    def documented(self) -> bool:
        """True if the node, or a method that it overrides, has a docstring; overloads need none."""
        if ast.get_docstring(self.node) is not None or "overload" in self.decorators:
            return True
        return self.owner is not None and any(
            ast.get_docstring(method) is not None
            for base in ancestors(self.owner)
            for method in methods(base)
            if method.name == self.node.name
        )

    @property
    def typed(self) -> bool:
        """True if all arguments and the return value of a function are annotated."""
        if isinstance(self.node, ast.ClassDef):
            return True
        signature = self.node.args
        arguments = [*signature.posonlyargs, *signature.args, *signature.kwonlyargs]
        if self.owner is not None and "staticmethod" not in self.decorators:
            arguments = arguments[1:]
        arguments += [argument for argument in (signature.vararg, signature.kwarg) if argument is not None]
        return self.node.returns is not None and all(argument.annotation is not None for argument in arguments)


def public(*folders: str) -> Iterator[Public]:
    """All public functions, classes and methods in the given folders."""
    for file in files(*folders):
        for node in tree(file).body:
            if isinstance(node, Function | ast.ClassDef) and is_public(node.name):
                yield Public(file, node)
                if isinstance(node, ast.ClassDef):
                    yield from (Public(file, method, node) for method in methods(node) if is_public(method.name))


def methods(node: ast.ClassDef) -> list[Function]:
    """Methods defined in the body of a class."""
    return [member for member in node.body if isinstance(member, Function)]


@functools.cache
def classes() -> dict[str, ast.ClassDef]:
    """All classes at module level in labkit, name -> node."""
    return {node.name: node for file in files("labkit") for node in tree(file).body if isinstance(node, ast.ClassDef)}


def ancestors(node: ast.ClassDef) -> Iterator[ast.ClassDef]:
    """Base classes of a class that are defined in labkit, nearest first."""
    for base in node.bases:
        base = base.value if isinstance(base, ast.Subscript) else base  # Task in Task[State]
        known = classes().get(base.id) if isinstance(base, ast.Name) else None
        if known is not None:
            yield known
            yield from ancestors(known)


def functions(file: Path) -> Iterator[Function]:
    """All functions of a file, including nested and private ones."""
    return (node for node in ast.walk(tree(file)) if isinstance(node, Function))


def imports(file: Path, for_types: bool = False) -> Iterator[tuple[int, str]]:
    """(line, module) of every import of a file, also inside functions, and with `for_types` those for type checkers.

    A public name such as `labkit.open_run` counts as an import of the module that defines it.
    """
    for node in ast.walk(tree(file)) if for_types else _running(tree(file)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name_of(file)}:{node.lineno}: use the full name of the module"
            yield from ((node.lineno, _origin(node.module or "", alias.name)) for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "labkit":
            yield node.lineno, _origin("labkit", node.attr)


def private_names(file: ast.Module) -> set[str]:
    """Private names that a file imports or takes from objects, without those that it defines itself."""
    nodes = [*ast.walk(file)]
    own = {node.name for node in nodes if isinstance(node, Function | ast.ClassDef)}
    own |= {node.attr for node in nodes if isinstance(node, ast.Attribute) and _name_of(node.value) in OWNERS}
    used: list[str] = []
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            used += [alias.name for alias in node.names]
        elif isinstance(node, ast.Attribute):
            used.append(node.attr)
        elif isinstance(node, ast.Call) and _name_of(node.func) in ("getattr", "setattr", "hasattr"):
            used += [str(text.value) for text in node.args if isinstance(text, ast.Constant)]
    return {name for name in used if is_private(name)} - own - DOCUMENTED


def inherited_private_names(kind: type) -> set[str]:
    """Private names that a class uses or redefines and a class of a library, from which it inherits, defines."""
    used = set(re.findall(r"\w+", _source(kind)))
    bases = [base for base in kind.__mro__ if not base.__module__.startswith(("labkit", "tests", "builtins"))]
    theirs = {name for base in bases for name in re.findall(r"(?:self\.|def )(\w+)", _source(base))}
    return {name for name in used & theirs if is_private(name)}


def _source(kind: type) -> str:
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):  # written in C, or made by a function
        return "".join(f"def {name}\n" for name in vars(kind))


def is_private(name: str) -> bool:
    """True if a name begins with one underscore; ctypes and enum document those that also end with one."""
    return name.startswith("_") and not name.startswith("__") and not name.endswith("_")


def _name_of(node: ast.expr) -> str | None:
    return node.id if isinstance(node, ast.Name) else None


def _origin(module: str, name: str) -> str:
    """Name of the module that `from module import name` loads."""
    if module != "labkit":
        return module
    if (LABKIT / name).is_dir() or (LABKIT / f"{name}.py").is_file():
        return f"labkit.{name}"
    return DOOR.get(name, ("labkit", name))[0]


def _running(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below a node, without the bodies of `if TYPE_CHECKING:`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING":
            continue
        yield child
        yield from _running(child)
