"""Writes the sources of the user material with PROPS, builds them with gfortran and gcc, and calls the compiled law."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from labkit.errors import InputError, PhysicsError
from labkit.files.atomic import whole_file, write_text
from labkit.model.parameters import Model
from labkit.model.rates import REASONS, STATE
from labkit.plugins.umat.fortran import equations
from labkit.plugins.umat.material_point import Update, points
from labkit.plugins.umat.props import STATE_NAMES, TOLERANCE, PointStart, properties

FOLDER = Path(__file__).parent
FORTRAN, C = FOLDER / "labkit_umat.f90", FOLDER / "labkit_mgis.c"
SOURCES = (FORTRAN, C)
NAME = "liblabkit_umat.so"
FLAGS = ("-O3", "-finline-limit=2000")  # inlining of the small tensor functions makes this 1.4 times as fast as -O2
NO_START, WRONG_INPUT = 9, 10
STATUS = REASONS | {
    NO_START: "no initial state: give a state, or the initial void ratio and a compressive stress or a pressure",
    WRONG_INPUT: "PROPS are not the constants of a model",
}


def missing_compilers() -> tuple[str, ...]:
    """Return the names of compilers that `build` needs but that are not on the search path."""
    return tuple(name for name in ("gfortran", "gcc") if shutil.which(name) is None)


def build(folder: Path) -> Path:
    """Compile the sources in `folder` to the shared library NAME there; returns its path.

    Raises InputError if a compiler is missing, and PhysicsError with the compiler's message if compilation fails.
    """
    missing = missing_compilers()
    if missing:
        raise InputError(f"{' and '.join(missing)} not found: install with apt-get install gfortran gcc")
    with tempfile.TemporaryDirectory(prefix="labkit-") as place:
        for source in SOURCES:
            shutil.copy(folder / source.name, place)
        for command in build_commands():
            done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
            if done.returncode:
                raise PhysicsError(f"{command[0]} failed: {done.stderr.strip()}")
        with whole_file(folder / NAME) as temporary:
            shutil.copyfile(Path(place, NAME), temporary)
    return folder / NAME


def build_commands() -> tuple[list[str], ...]:
    """Return the commands of `build`, to be run in the folder of the sources."""
    return (
        ["gcc", "-O2", "-std=c99", "-fPIC", "-c", C.name],
        ["gfortran", *FLAGS, "-std=f2008", "-shared", "-fPIC", "-o", NAME, FORTRAN.name, "labkit_mgis.o"],
    )


def copy_sources(folder: Path, properties: int = 30) -> None:
    """Write the sources with the equations to a folder; `properties` is the number of PROPS that MGIS passes."""
    for source in SOURCES:
        text = source.read_text(encoding="utf-8").replace("PROPERTIES = 30", f"PROPERTIES = {properties}")
        write_text(folder / source.name, text.replace("!EQUATIONS\n", equations() if source is FORTRAN else ""))


def _address(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


class Library:
    """The compiled law of one model: the same functions as labkit.plugins.umat.material_point, called through C."""

    def __init__(self, file: Path, model: Model, start: PointStart | None = None, tolerance: float = TOLERANCE) -> None:
        """Load a library that `build` has compiled."""
        self._library = ctypes.CDLL(str(file))
        self.props = np.array(list(properties(model, start, tolerance).values()))

    def update(self, state: np.ndarray, increment: np.ndarray, tangent: bool = True) -> Update:
        """Update points like material_point.update, but with finite stress and tangent if a point fails.

        A failed point keeps its stress from before the increment.

        Args:
            state: (n, 21), Mandel notation, compression positive.
            increment: Strain increment, (n, 6).
            tangent: True to compute the tangent.
        """
        new, increment = points(state, increment)
        n = len(new)
        stress, tangents = np.empty((n, 6)), np.empty((n if tangent else 0, 6, 6))
        status, substeps = np.empty(n, np.intc), np.empty(n, np.intc)
        self._library.labkit_update(
            ctypes.c_int(n),
            ctypes.c_int(len(self.props)),
            *(_address(array) for array in (self.props, new, increment)),
            ctypes.c_int(tangent),
            *(_address(array) for array in (stress, tangents, status, substeps)),
        )
        return Update(new, stress, tangents if tangent else None, status.astype(np.int64), substeps.astype(np.int64))

    def initial_state(self, stress: np.ndarray) -> np.ndarray:
        """Return the state (21,) under a stress (6,), compression positive, with A = F^t = 0.

        Raises InputError if the law finds no such state.
        """
        stress, state = np.ascontiguousarray(stress, dtype=float), np.empty(STATE)
        status = self._library.labkit_initial_state(
            ctypes.c_int(len(self.props)), _address(self.props), _address(stress), _address(state)
        )
        if status:
            raise InputError(STATUS[status])
        return state


TABLE, INCLUDE = "props.csv", "labkit_material.inp"


def props_table(props: dict[str, float]) -> str:
    """Return PROPS as CSV: number, name, value."""
    return "number,name,value\n" + "".join(
        f"{number},{name},{value!r}\n" for number, (name, value) in enumerate(props.items(), start=1)
    )


def abaqus_material(props: dict[str, float]) -> str:
    """Return the lines of an Abaqus input file that define the material LABKIT with these PROPS."""
    values = [f"{value!r}" for value in props.values()]
    rows = [", ".join(values[k : k + 8]) for k in range(0, len(values), 8)]
    names = [f"{number}, {name}, {name}" for number, name in enumerate(STATE_NAMES, start=1)]
    return "\n".join(
        [
            "*MATERIAL, NAME=LABKIT",
            f"*USER MATERIAL, CONSTANTS={len(values)}, UNSYMM",
            *rows,
            "*DEPVAR",
            f"{len(names)},",
            *names,
            "",
        ]
    )


def write(folder: Path, props: dict[str, float]) -> list[Path]:
    """Write the sources, the table and the include file to an existing folder; returns the files."""
    copy_sources(folder, len(props))
    write_text(folder / TABLE, props_table(props))
    write_text(folder / INCLUDE, abaqus_material(props))
    return sorted(folder / name for name in ("labkit_umat.f90", "labkit_mgis.c", TABLE, INCLUDE))
