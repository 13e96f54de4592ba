"""`labkit umat`: the constitutive model as a material law for finite-element programs."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Literal

from labkit.cli.arguments import Instance, Option
from labkit.cli.model import Beyond, ModelParameters
from labkit.cli.registry import command
from labkit.errors import InputError
from labkit.parameters import parameter
from labkit.plugins.umat.props import TOLERANCE, PointStart, properties
from labkit.units import UNITS


@dataclasses.dataclass(frozen=True)
class PointOptions(PointStart):
    """Initial state of points for which the finite-element program specifies none, and the tolerance."""

    tolerance: float = parameter(TOLERANCE, low=1e-12, high=1.0, help="relative error allowed in one substep")


@command("umat")
def umat_command(
    *,
    output: Annotated[str, Option("folder to write, made if missing", "FOLDER")],
    build: Annotated[bool, Option("also compile the sources, with gfortran and gcc")] = False,
    parameters: ModelParameters = None,
    beyond_e_cmax: Annotated[
        Beyond,
        Option(
            "for void ratios above e_cmax: cut the increment (default), or use flat lines, Z^c = 4 and Lambda^c = 0"
        ),
    ] = "error",
    stress_unit: Annotated[
        Literal["Pa", "kPa", "MPa", "GPa"], Option("unit of stress of the finite-element analysis")
    ] = "Pa",
    point: Annotated[PointOptions, Instance(PointOptions, "points of the finite-element analysis")],
) -> None:
    """Writes the constitutive model as a material law for finite-element programs.

    These are Fortran and C sources, the table of PROPS, and with --build the shared library.

    Example:
        labkit umat -o law --build
    """
    from labkit.model.run_file import read_model
    from labkit.plugins.umat import library
    from labkit.plugins.umat.library import write

    model = read_model(parameters).reading(beyond_e_cmax=beyond_e_cmax)
    if point.void_ratio is not None:
        model.require_density(point.void_ratio)
    props = properties(model, point, point.tolerance, UNITS["Pa"][stress_unit])
    folder = Path(output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = write(folder, props)
    except OSError as error:
        raise InputError(f"{error.filename} cannot be written ({error.strerror}): choose another --output") from None
    if build:
        files.append(library.build(folder))
    for file in files:
        print(f"written: {file}")
