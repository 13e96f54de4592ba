"""A path, a part of a contact law, a statistic or an engine needs few lines, with public names only.

The lines are those of all classes and functions with their decorators, without docstrings, comments and blank lines,
and without the figure of a statistic.
tests/examples, tests/test_extensions.py and tests/plugins/campaigns/test_own_files.py run them and others: as an
option, in a campaign, in verify and as a figure.
"""

import ast

import pytest

import labkit
from tests.house.source import ROOT

EXAMPLES = ROOT / "examples"
MOST_LINES = {"own_path": 12, "own_part": 15, "own_statistic": 8, "own_engine": 25}


def decorators(node):
    """Names of the decorators of a definition."""
    called = [one.func if isinstance(one, ast.Call) else one for one in node.decorator_list]
    return [one.attr if isinstance(one, ast.Attribute) else one.id for one in called]


def docstring_lines(node):
    """Lines of all docstrings in a definition."""
    lines = set()
    for one in ast.walk(node):
        if isinstance(one, ast.ClassDef | ast.FunctionDef) and ast.get_docstring(one) is not None:
            lines |= set(range(one.body[0].lineno, one.body[0].end_lineno + 1))
    return lines


def code_lines(text, node):
    """Number of lines of code of a definition, decorators included."""
    first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
    lines = set(range(first, node.end_lineno + 1)) - docstring_lines(node)
    stripped = [text.splitlines()[number - 1].strip() for number in sorted(lines)]
    return sum(bool(line) and not line.startswith("#") for line in stripped)


THERE = [name for name in MOST_LINES if (EXAMPLES / f"{name}.py").exists()]


@pytest.mark.parametrize("name", THERE)
def test_an_extension_is_short(name):
    text = (EXAMPLES / f"{name}.py").read_text()
    defined = [one for one in ast.parse(text).body if isinstance(one, ast.ClassDef | ast.FunctionDef)]
    lines = {one.name: code_lines(text, one) for one in defined if "register_figure" not in decorators(one)}
    assert 0 < sum(lines.values()) <= MOST_LINES[name], lines


@pytest.mark.parametrize("name", THERE)
def test_an_extension_uses_only_what_labkit_publishes(name):
    """`import labkit as lk`, or names that a package of labkit lists in its __all__."""
    for node in ast.walk(ast.parse((EXAMPLES / f"{name}.py").read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("labkit"):
            package = __import__(node.module, fromlist=["__all__"])
            assert {alias.name for alias in node.names} <= set(package.__all__), node.module
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "lk":
            assert node.attr in labkit.__all__, node.attr


def test_lines_are_counted_without_docstrings_and_comments():
    text = '@one\n@two(3)\nclass A:\n    """Two\n    lines."""\n\n    # why\n    x = 1\n\n'
    text += '    def f(self):\n        """f."""\n'
    node = ast.parse(text).body[0]
    assert code_lines(text, node) == 5 and decorators(node) == ["one", "two"]
