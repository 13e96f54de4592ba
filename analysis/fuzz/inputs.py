"""The inputs to be damaged, the data read from them, and the commands and hostile values of `inputs.yaml`."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import json
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import labkit as lk
from analysis.places import read_yaml
from labkit.model import Model, read_model

GIVEN: dict[str, Any] = read_yaml(Path(__file__).with_suffix(".yaml"))
VALUES = (*GIVEN["values"], "9" * 30, "x" * 300, "[" * 2000)
COMMANDS: Mapping[str, tuple[list[str], list[str]]] = GIVEN["commands"]  # command -> words, options that take a value
NEVER_STARTS = ("run", "consolidate", "specimen")  # these write to a folder that does not exist


def make_inputs(folder: Path) -> dict[str, Path]:
    """Undamaged files in a folder, name -> file: a state, a complete run, and an unfinished one."""
    files = {name: folder / name for name in ("s.state.nc", "r.run.nc")}
    state = lk.make_specimen(lk.Recipe(void_ratio=0.66, grains=100), lk.Scene(), progress=False)
    lk.write_state(files["s.state.nc"], state)
    path = lk.paths.ConstantVolume(strain=4e-3, rate=50.0)
    with warnings.catch_warnings(action="ignore"):  # faster than quasi-static
        lk.run(state, path, file=files["r.run.nc"], progress=False, snapshots=2)
    for name, (content, _) in TEXTS.items():
        (folder / name).write_bytes(content())
    for name, write in INSTALLED.items():
        write(state, folder / name)
    return files


def numbers(values: Mapping[str, Any]) -> str:
    """A hash of named arrays, to compare what is read."""
    digest = hashlib.sha256()
    for name in sorted(values):
        digest.update(name.encode() + np.ascontiguousarray(values[name]).tobytes())
    return digest.hexdigest()


def read_state(file: Path) -> str:
    """Read the data of a state file that a run uses."""
    state = lk.read_state(file)
    return numbers({"digest": np.frombuffer(state.digest().encode(), np.uint8), "step": state.time_step})


def read_run(file: Path) -> str:
    """Read the data of a run file that statistics use."""
    run = lk.Run.open(file)
    try:
        values = {str(name): run.data[name].values for name in run.data.variables if run.data[name].dtype.kind in "fiu"}
        values |= {f"love {k}": lk.love_stress(snapshot) for k, snapshot in enumerate(run.snapshots)}
        return numbers(values | {"scene": np.frombuffer(run.scene.to_json().encode(), np.uint8)})
    finally:
        run.data.close()


def resume(file: Path) -> str:
    """Read the data of a checkpoint that the continuation of a run uses."""
    state = lk.read_state(file)
    return numbers({"digest": np.frombuffer(state.digest().encode(), np.uint8), "step": state.step})


def read_text(file: Path) -> str:
    """Read a text file like the command to which its name belongs; returns `used`, because other text may be valid."""
    TEXTS[file.name][1](file)
    return "used"


def read_packing(file: Path) -> object:
    """Read another program's packing as a state."""
    return lk.import_state(file, lk.Scene(), length_unit="mm")


def read_grading(file: Path) -> object:
    """A sieve curve as the grading of a scene, with some grains of it."""
    return lk.Scene(grading=str(file)).sizes.draw(1e-9, np.random.default_rng(1))


EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SIEVES = "diameter_mm,passing_percent\n0.1,0\n0.15,30\n0.2,70\n0.3,100\n"
TEXTS: dict[str, tuple[Callable[[], bytes], Callable[[Path], object]]] = {  # file -> (content, function that reads it)
    "model.json": (lambda: json.dumps(dataclasses.asdict(Model())).encode(), read_model),
    "steps.path.yaml": (GIVEN["steps"].encode, lk.read_path),
    "sieves.csv": (SIEVES.encode, read_grading),
    "packing.txt": (lambda: b"".join((EXAMPLES / "own_packing.txt").open("rb").readlines()[:60]), read_packing),
}


def write_vtp(state: lk.State, file: Path) -> None:
    """Write the grains of a state as a VTK file in binary."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    points, grains, writer = vtkPoints(), vtkPolyData(), vtkXMLPolyDataWriter()
    points.SetData(numpy_to_vtk(state.position, deep=True))
    grains.SetPoints(points)
    radius = numpy_to_vtk(state.radius, deep=True)
    radius.SetName("radius")
    grains.GetPointData().AddArray(radius)
    writer.SetFileName(str(file))
    writer.SetInputData(grains)
    writer.Write()


def write_vtk(state: lk.State, file: Path) -> None:
    """Write the grains of a state as a legacy VTK file in text."""
    n, numbers_of = state.number_of_grains, lambda values: " ".join(f"{value:.9g}" for value in np.ravel(values))
    head = "# vtk DataFile Version 3.0\ngrains\nASCII\nDATASET POLYDATA\n"
    data = f"POINT_DATA {n}\nSCALARS radius double 1\nLOOKUP_TABLE default\n{numbers_of(state.radius)}\n"
    file.write_text(f"{head}POINTS {n} double\n{numbers_of(state.position)}\n{data}")


def write_ondem(state: lk.State, file: Path) -> None:
    """Write a state as an ON-DEM file."""
    lk.exchange.FORMATS["ondem"]().write(state, file)


def read_foreign(file: Path) -> str:
    """Read the grains of a file of another program; returns `used`, because other numbers may be valid."""
    lk.import_snapshot(file, lk.Scene(), box="1,1,1", length_unit="m", size="radius", force_sign="tension")
    return "used"


FOREIGN = {  # file -> (module that it needs, function that writes it)
    "grains.vtp": ("vtkmodules", write_vtp),
    "grains.vtk": ("vtkmodules", write_vtk),
    "grains.vtkhdf": ("h5py", write_ondem),
}
INSTALLED = {name: write for name, (module, write) in FOREIGN.items() if importlib.util.find_spec(module)}
READERS: dict[str, tuple[str, Callable[[Path], str]]] = {  # name of the data -> (file, function that reads them)
    "state": ("s.state.nc", read_state),
    "run": ("r.run.nc", read_run),
    "checkpoint": ("r.run.nc", resume),
    **{name: (name, read_text) for name in TEXTS},
    **{name: (name, read_foreign) for name in INSTALLED},
}
