"""Executes the cells of a tutorial one after the other, as a notebook would: a program, given the page.

Every page runs in a separate process, because what a tutorial registers with labkit must not affect other tests.
"""

import ast
import shlex
import sys
from pathlib import Path

import matplotlib

from labkit.cli import main
from tests.docs.pages import cells


def labkit(command):
    """`!labkit ...` of a notebook."""
    program, *arguments = shlex.split(command)
    assert program == "labkit"
    return main(arguments)


def execute(cell, names, title):
    """Run a cell; the value of its last line is shown as a notebook shows it."""
    lines = [f"labkit_({line[1:]!r})" if line.startswith("!") else line for line in cell.splitlines()]
    tree = ast.parse("\n".join(lines), title)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, title, "exec"), names)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), title, "eval"), names)
        html = getattr(value, "_repr_html_", None)
        print(html() if html else repr(value))


if __name__ == "__main__":
    page = Path(sys.argv[1])
    matplotlib.use("Agg")
    names = {"__name__": "__main__", "labkit_": labkit}
    for number, cell in enumerate(cells(page)):
        execute(cell, names, f"{page.name}, cell {number}")
