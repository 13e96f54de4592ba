"""Every tutorial runs: its cells one after the other, as a notebook would run them."""

import ast
import contextlib
import io
import shlex

import matplotlib
import pytest

from labkit.cli import main
from tests.docs.pages import DOCS, cells

TUTORIALS = sorted((DOCS / "tutorials").glob("0*.md"))


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


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_runs(page, tmp_path, monkeypatch):
    (tmp_path / "docs" / "tutorials").mkdir(parents=True)
    (tmp_path / "examples").symlink_to(DOCS.parent / "examples")
    monkeypatch.chdir(tmp_path / "docs" / "tutorials")
    matplotlib.use("Agg")
    output, names = io.StringIO(), {"__name__": "__main__", "labkit_": labkit}
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        for number, cell in enumerate(cells(page)):
            execute(cell, names, f"{page.name}, cell {number}")
    text = output.getvalue()
    assert text and "Traceback" not in text
    for promise in PROMISES[page.stem]:
        assert promise in text


PROMISES = {  # what the text around the cells says of their output
    "01_first_test": ("friction -0.5", "cp on fused", "True", "Run(cv on fused, complete"),
    "02_c0_and_love": ("the same as lk.sff_stress: True", "C0 against Love", "energy balance"),
    "03_your_own": ("Run(constant_axial_stress on fused, complete", "Run(steps on fused, complete", "0.58 to 1.62"),
    "04_probes": ("elastic", "asymmetry"),
    "05_campaign": ("strian", "cp-dense-p200kPa"),
    "06_model_and_fe": ("q/p at the end: 0.9", "labkit_umat.f90", "[1. 1. 1. 1.]"),
    "07_large_specimens": ("core hours", "in mixed precision"),
}
