"""YADE runs in the system's interpreter: the rooms below the line of the two Pythons need numpy and netCDF4 alone."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BELOW = ("io", "micro", "sff", "dem", "engines")  # whole rooms, but for the compiled engine
COMPILED = ("engines/fused.py", "engines/kernel", "engines/cuda")
COMMANDS = [f"cli/{name}.py" for name in ("__init__", "arguments", "parser", "registry", "simulate", "yade_main")]

REFUSE = """
import importlib, importlib.abc, sys
import netCDF4, numpy  # with what they need themselves
known = {"labkit", "numpy", "netCDF4", *sys.stdlib_module_names, *(name.split(".")[0] for name in sys.modules)}
class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] not in known:
            raise ImportError(name + " is not for YADE's interpreter")
sys.meta_path.insert(0, Refuse())
sys.path.append(sys.argv[1])
for name in sys.argv[2:]:
    importlib.import_module(name)
"""

MEASURE = """
from labkit.dem.measure import measure
from labkit.dem.scene import Scene
from labkit.dem.specimen import Recipe, insert_grains
state = insert_grains(Scene(), Recipe(0.67, side=1e-3))
print(sorted(measure(state, state.cell))[0])
"""


def in_the_systems_interpreter(code, *modules):
    command = ["/usr/bin/python3", "-W", "error", "-c", REFUSE + code, str(ROOT), *modules]
    return subprocess.run(command, capture_output=True, text=True)


def modules():
    """All modules below the line, and the commands that run inside YADE."""
    labkit = ROOT / "labkit"
    files = [file for room in BELOW for file in (labkit / room).rglob("*.py")] + [labkit / name for name in COMMANDS]
    files += labkit.glob("*.py")
    kept = (file for file in files if not any(file.is_relative_to(labkit / place) for place in COMPILED))
    return sorted(".".join(file.relative_to(ROOT).with_suffix("").parts) for file in kept)


@pytest.mark.parametrize("module", modules())
def test_a_module_below_the_line_is_imported(module):
    done = in_the_systems_interpreter("", module.removesuffix(".__init__"))
    assert done.returncode == 0, done.stderr


def test_the_systems_interpreter_is_enough():
    done = in_the_systems_interpreter(MEASURE)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "axial_strain"


@pytest.mark.parametrize("library", ["scipy", "matplotlib", "pandas", "xarray", "tqdm", "numba", "yaml", "nothing"])
def test_another_library_would_be_noticed(library):
    done = in_the_systems_interpreter(f"import {library}")
    assert done.returncode == 1 and f"{library} is not for YADE's interpreter" in done.stderr


@pytest.mark.parametrize("module", ["labkit.engines.fused", "labkit.runs.dataset", "labkit.visuals.plots"])
def test_a_module_above_the_line_is_not_imported(module):
    done = in_the_systems_interpreter(f"import {module}")
    assert done.returncode == 1 and "is not for YADE's interpreter" in done.stderr
