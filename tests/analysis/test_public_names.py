"""The studies use only the public names of labkit and its subpackages."""

import ast
import importlib
from pathlib import Path

ANALYSIS = Path(__file__).resolve().parents[2] / "analysis"
EXTENSIONS = ("peers", "stratified")  # extend labkit, as plug-ins do, and use its inner names
FILES = sorted(file for file in ANALYSIS.rglob("*.py") if file.parent.name not in EXTENSIONS)
FRAME = {"labkit.cli", "labkit.cli.arguments", "labkit.cli.dispatch", "labkit.cli.registry", "labkit.errors"}
NAMES = """engines figures files grains micro model paths process quantities records results servo sff simulation
specimens text"""
PLUGINS = "campaigns laboratory_data umat"
ROOMS = {f"labkit.{name}" for name in NAMES.split()} | {f"labkit.plugins.{name}" for name in PLUGINS.split()}


def imported(file):
    """(module, name) of every import of a file from labkit; the module is `labkit` for lk.name."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names if alias.name.split(".")[0] == "labkit")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "labkit":
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "lk":
            yield "labkit", node.attr


def is_public(module, name):
    if name is None:
        return module == "labkit"  # names are imported from a subpackage
    return module in FRAME or (module in ROOMS | {"labkit"} and name in importlib.import_module(module).__all__)


def test_only_public_names_are_imported():
    """From labkit or a subpackage."""
    names = [(str(file.relative_to(ANALYSIS)), *each) for file in FILES for each in imported(file)]
    assert [each for each in names if not is_public(*each[1:])] == []


def test_labkit_is_imported_as_lk():
    nodes = [(file, node) for file in FILES for node in ast.walk(ast.parse(file.read_text()))]
    aliases = [(str(file), alias) for file, node in nodes if isinstance(node, ast.Import) for alias in node.names]
    assert [file for file, alias in aliases if alias.name == "labkit" and alias.asname != "lk"] == []
