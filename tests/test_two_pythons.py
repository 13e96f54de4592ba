"""What YADE's interpreter imports needs numpy and netCDF4 alone."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

BARE = """
import importlib.abc, sys
class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"scipy", "matplotlib", "pandas", "xarray", "tqdm", "numba"}:
            raise ImportError(name + " is not for YADE's interpreter")
sys.meta_path.insert(0, Refuse())
sys.path.append(sys.argv[1])
import labkit.cli.arguments, labkit.cli.commands, labkit.dem.measure, labkit.micro.fabric, labkit.dem.paths, labkit.dem.recorder
import labkit.dem.scene, labkit.sff.c0, labkit.dem.simulation, labkit.dem.specimen, labkit.dem.state, labkit.cli.yade_main, labkit.io.progress
import labkit.io.provenance
from labkit.dem.specimen import Recipe, insert_grains
from labkit.dem.measure import measure
state = insert_grains(labkit.dem.scene.Scene(), Recipe(0.67, side=1e-3))
print(sorted(measure(state, state.cell))[0])
"""


def test_the_systems_interpreter_is_enough():
    done = subprocess.run(["/usr/bin/python3", "-W", "error", "-c", BARE, ROOT], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "axial_strain"
