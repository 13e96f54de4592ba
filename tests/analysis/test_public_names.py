"""The studies use only the public names of labkit and its subpackages."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ANALYSIS = Path(__file__).resolve().parents[2] / "analysis"
FILES = sorted(ANALYSIS.rglob("*.py"))
FRAME = {"labkit.cli.arguments", "labkit.cli.dispatch", "labkit.cli.registry", "labkit.errors"}  # of commands
NAMES = "campaigns engines figures grains io laboratory_data micro model paths quantities records runs servo sff"
ROOMS = {f"labkit.{name}" for name in (*NAMES.split(), "specimens", "umat")}


def imported(file):
    """(module, name) of every import of a file from labkit; the module is `labkit` for lk.name."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names if alias.name.split(".")[0] == "labkit")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "labkit":
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "lk":
            yield "labkit", node.attr


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ANALYSIS)))
def test_only_public_names_are_imported(file):
    for module, name in imported(file):
        if name is None:
            assert module == "labkit", f"{module}: import names from a subpackage"
        elif module not in FRAME:
            assert module in ROOMS | {"labkit"}, (
                f"{module} is private to a subpackage: import {name} from the subpackage"
            )
            assert name in importlib.import_module(module).__all__, f"{name} is not public in {module}"


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ANALYSIS)))
def test_labkit_is_imported_as_lk(file):
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            assert all(alias.asname == "lk" for alias in node.names if alias.name == "labkit")


def test_the_library_does_not_import_the_studies():
    library = ANALYSIS.parent / "labkit"
    for file in library.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            module = node.module if isinstance(node, ast.ImportFrom) else None
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [module or ""]
            assert not any(name.split(".")[0] == "analysis" for name in names), file


def test_every_study_is_a_command_of_lab_and_described():
    from analysis.__main__ import STUDIES

    root = Path(__file__).resolve().parents[2]
    studies = re.search(r"\n    (paper [^)]*)\)", (root / "lab").read_text())
    assert studies and set(re.findall(r"[\w-]+", studies[1])) == set(STUDIES)
    described = (root / "analysis/README.md").read_text()
    assert [name for name in STUDIES if f"| `./lab {name}" not in described] == []
