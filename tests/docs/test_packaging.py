"""Versions and dependencies are the same wherever they are stated."""

import json
import re
import tomllib

import pytest
import yaml

import labkit
from tests.docs.pages import DOCS

pytestmark = pytest.mark.slow

ROOT = DOCS.parent
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text()
CONDA = {"matplotlib": "matplotlib-base", "netCDF4": "netcdf4"}  # names that differ from those of PyPI


@pytest.fixture(scope="module")
def recipe():
    return yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text())


def test_the_version_is_the_same_everywhere(recipe):
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    codemeta = json.loads((ROOT / "codemeta.json").read_text())
    assert {recipe["context"]["version"], citation["version"], codemeta["version"]} == {labkit.__version__}


def test_the_conda_recipe_has_the_dependencies_of_the_package(recipe):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    stated = [each.partition(";")[0] for each in project["dependencies"]]  # without the markers of platforms
    names = {re.match(r"[\w-]+", each)[0]: each for each in stated}
    expected = {f"{CONDA.get(name, name)}{one.removeprefix(name)}" for name, one in names.items()}
    assert {one.replace(" ", "") for one in recipe["requirements"]["run"]} == {*expected, "python>=${{python_min}}"}
    assert project["requires-python"] == f">={recipe['context']['python_min']}"
    codemeta = json.loads((ROOT / "codemeta.json").read_text())
    assert set(codemeta["softwareRequirements"]) == set(names)


def test_every_dependency_has_a_lower_bound():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    stated = [*project["dependencies"], *(one for extra in project["optional-dependencies"].values() for one in extra)]
    assert [one for one in stated if not re.search(r"[>=]=|^labkit\[", one)] == []


def test_continuous_integration_runs_what_contributing_names():
    """Not parts of it: a folder, a marker, one file."""
    commands = re.findall(
        r"^    (\./lab test(?: --\w+)?|\./lab docs|\.ci/\w+|tox -e \w+)(?= )", CONTRIBUTING, re.MULTILINE
    )
    run = (ROOT / ".github/workflows/tests.yml").read_text() + (ROOT / ".ci/run").read_text()
    assert len(commands) > 6 and [command for command in commands if command not in run] == []


@pytest.mark.parametrize("file", ["Dockerfile", "Apptainer.def"])
def test_containers_install_what_lab_installs(file):
    text = (ROOT / "packaging" / file).read_text()
    assert all(package in text for package in ("yade", "python3-venv", "gfortran g++"))
    extras = re.search(r"labkit\[([\w,]+)\]", text)[1].split(",")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(extras) <= set(project["optional-dependencies"])


def test_every_citation_of_the_paper_has_a_reference():
    cited = set(re.findall(r"@(\w+)", (ROOT / "paper.md").read_text().split("---", 2)[2]))
    known = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text(), re.MULTILINE))
    assert cited == known


def test_zenodo_gets_what_the_citation_says():
    """The fields are those of Zenodo's deposit metadata (https://developers.zenodo.org/#representation)."""
    zenodo, citation = (
        json.loads((ROOT / ".zenodo.json").read_text()),
        yaml.safe_load((ROOT / "CITATION.cff").read_text()),
    )
    assert zenodo["upload_type"] == citation["type"] == "software" and zenodo["access_right"] == "open"
    for name in ("title", "version", "license", "keywords"):
        assert zenodo[name] == citation[name]
    assert zenodo["description"].split() == citation["abstract"].split()
    assert [one["name"] for one in zenodo["creators"]] == [one["name"] for one in citation["authors"]]
    assert [one["identifier"] for one in zenodo["related_identifiers"]] == [
        one["doi"] for one in citation["references"]
    ][:1]
