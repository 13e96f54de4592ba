"""The rules of the house: what is public is typed and documented, functions and files are small, no import runs
upwards, and `import labkit` costs nothing.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import labkit
from tests.house.source import LABKIT, ROOT, files, functions, imports, name_of, public

# From the ground up: a room may import itself and what stands before it, and no other room of its own line.
FLOORS = (
    ("errors", "parameters", "extensions", "lazy"),
    ("io",),
    ("micro",),
    ("sff",),
    ("dem",),
    ("engines",),
    ("runs",),
    ("model",),
    ("campaign",),
    ("visuals",),
    ("bench",),
    ("cli",),
)
GROUND = 0
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
PACKAGES = [room for room in FLOOR if (LABKIT / room).is_dir()]

LONGEST_FUNCTION = 80  # lines
LONGEST_FILE = 350

# Where a heavy library may be imported. A plain `numba` in other rooms would end in YADE's interpreter, which lacks it.
ALLOWED = {
    "numba": ("engines/kernel", "engines/fused.py", "model", "visuals/render.py", "bench"),
    "llvmlite": ("engines/kernel",),
    "matplotlib": ("visuals",),
}


def room_of(file: Path) -> str:
    """The room, or the module beside the rooms, that a file of labkit belongs to."""
    return file.relative_to(LABKIT).parts[0].removesuffix(".py")


def test_every_room_has_its_floor():
    there = {room_of(file) for file in files("labkit")} - {"__init__"}
    assert there == set(FLOOR)


@pytest.mark.parametrize("folder", ["labkit", "analysis"])
def test_public_functions_are_typed(folder):
    assert [str(one) for one in public(folder) if not one.typed] == []


def test_what_is_public_is_documented():
    assert [str(one) for one in public("labkit") if not one.documented] == []


@pytest.mark.parametrize("file", files("labkit"), ids=name_of)
def test_files_say_what_they_are(file):
    text = file.read_text()
    assert text.startswith('"""')
    assert "from __future__ import annotations" in text or file.name == "__init__.py"


@pytest.mark.parametrize("file", files("labkit", "analysis", "yade_scripts", "examples"), ids=name_of)
def test_functions_and_files_are_small(file):
    lengths = {f"{one.name}, line {one.lineno}": one.end_lineno - one.lineno + 1 for one in functions(file)}
    assert {name: length for name, length in lengths.items() if length > LONGEST_FUNCTION} == {}
    assert len(file.read_text().splitlines()) <= LONGEST_FILE


@pytest.mark.parametrize("file", [file for file in files("labkit") if file.parent != LABKIT], ids=name_of)
def test_no_import_runs_upwards(file):
    own = room_of(file)
    for line, module in imports(file):
        package, *rest = module.split(".")
        if package == "labkit" and rest and rest[0] != own:
            assert FLOOR[rest[0]] < FLOOR[own], f"line {line}: {own} imports {module}"


@pytest.mark.parametrize("file", sorted(LABKIT.glob("*.py")), ids=name_of)
def test_the_modules_beside_the_rooms_import_no_room(file):
    for line, module in imports(file):
        package, *rest = module.split(".")
        assert package != "labkit" or not rest or FLOOR[rest[0]] == GROUND, f"line {line}: imports {module}"


@pytest.mark.parametrize("library", ALLOWED)
def test_heavy_libraries_stay_in_their_rooms(library):
    users = {
        file.relative_to(LABKIT)
        for file in files("labkit")
        for _, module in imports(file)
        if module.split(".")[0] == library
    }
    allowed = [Path(place) for place in ALLOWED[library]]
    assert {str(file) for file in users if not any(file.is_relative_to(place) for place in allowed)} == set()


def test_the_laboratory_does_not_import_what_stands_on_it():
    for file in files("labkit"):
        known = {module.split(".")[0] for _, module in imports(file)}
        assert not known & {"analysis", "examples", "tests", "yade_scripts"}, name_of(file)


def test_import_labkit_loads_no_library():
    libraries = {"numpy", "matplotlib", "xarray", "numba"}
    code = f"import sys, labkit; dir(labkit); print(*sorted({libraries} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("package", ["labkit", *(f"labkit.{room}" for room in PACKAGES)])
def test_public_names_resolve(package):
    module = importlib.import_module(package)
    names = getattr(module, "__all__", [])
    assert set(names) <= set(dir(module))
    for name in {*names, *dir(module)}:
        getattr(module, name)


def test_the_front_door_has_every_name_once():
    assert len(labkit.__all__) == len(set(labkit.__all__))
    with pytest.raises(AttributeError):
        labkit.nothing_of_this_name
