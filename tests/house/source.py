"""What the tests of the house read of the source: files, functions, classes, imports."""

from __future__ import annotations

import ast
import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path

import labkit

ROOT = Path(__file__).resolve().parents[2]
LABKIT = ROOT / "labkit"
CONSTRUCTORS = {"__init__", "__post_init__", "__call__"}  # of the dunder methods, those that somebody calls

Function = ast.FunctionDef | ast.AsyncFunctionDef


def files(*folders: str) -> list[Path]:
    """All Python files of some folders of the repository."""
    return sorted(file for folder in folders for file in (ROOT / folder).rglob("*.py"))


@functools.cache
def tree(file: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(file.read_text(), str(file))


def name_of(file: Path) -> str:
    """A file as it stands in the repository, for messages and names of tests."""
    return str(file.relative_to(ROOT))


def is_public(name: str) -> bool:
    """Whether a function, method or class is for others to use."""
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
    def documented(self) -> bool:
        """Whether it has a docstring, its own or that of the method that it overrides."""
        if ast.get_docstring(self.node) is not None:
            return True
        return self.owner is not None and any(
            ast.get_docstring(method) is not None
            for base in ancestors(self.owner)
            for method in methods(base)
            if method.name == self.node.name
        )

    @property
    def typed(self) -> bool:
        """Whether all arguments and the return of a function are annotated."""
        if isinstance(self.node, ast.ClassDef):
            return True
        given = self.node.args
        arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs]
        static = any(isinstance(one, ast.Name) and one.id == "staticmethod" for one in self.node.decorator_list)
        if self.owner is not None and not static:
            arguments = arguments[1:]
        arguments += [one for one in (given.vararg, given.kwarg) if one is not None]
        return self.node.returns is not None and all(one.annotation is not None for one in arguments)


def public(*folders: str) -> Iterator[Public]:
    """Everything public in some folders."""
    for file in files(*folders):
        for node in tree(file).body:
            if isinstance(node, Function | ast.ClassDef) and is_public(node.name):
                yield Public(file, node)
                if isinstance(node, ast.ClassDef):
                    yield from (Public(file, method, node) for method in methods(node) if is_public(method.name))


def methods(node: ast.ClassDef) -> list[Function]:
    """The methods that a class defines itself."""
    return [one for one in node.body if isinstance(one, Function)]


@functools.cache
def classes() -> dict[str, ast.ClassDef]:
    """Name -> class, of all classes at module level in labkit."""
    return {node.name: node for file in files("labkit") for node in tree(file).body if isinstance(node, ast.ClassDef)}


def ancestors(node: ast.ClassDef) -> Iterator[ast.ClassDef]:
    """The classes of labkit that a class inherits from, nearest first."""
    for base in node.bases:
        known = classes().get(base.id) if isinstance(base, ast.Name) else None
        if known is not None:
            yield known
            yield from ancestors(known)


def functions(file: Path) -> Iterator[Function]:
    """All functions of a file, nested and private ones too."""
    return (node for node in ast.walk(tree(file)) if isinstance(node, Function))


def imports(file: Path) -> Iterator[tuple[int, str]]:
    """(line, module) of every import of a file, those inside functions too, but not those for type checkers.

    What is taken from the front door, `labkit.open_run`, counts as an import of the module that has it.
    """
    for node in _running(tree(file)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name_of(file)}:{node.lineno}: give the whole name of the module"
            yield from ((node.lineno, _origin(node.module or "", alias.name)) for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "labkit":
            yield node.lineno, _origin("labkit", node.attr)


def _origin(module: str, name: str) -> str:
    """The module that `from module import name` loads."""
    if module != "labkit":
        return module
    if (LABKIT / name).is_dir() or (LABKIT / f"{name}.py").is_file():
        return f"labkit.{name}"
    return f"labkit.{labkit._NAMES[name].partition(':')[0]}" if name in labkit._NAMES else "labkit"


def _running(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes below a node that are executed: without `if TYPE_CHECKING:`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING":
            continue
        yield child
        yield from _running(child)
