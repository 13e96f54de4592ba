"""VTK files of other programs (.vtp, .vtu, legacy .vtk): grains as points, contacts as lines between their centres."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from labkit.errors import InputError
from labkit.plugins.exchange.columns import CONTACT, GRAIN, contacts_from, grains_from, renamed
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.formats import Format, damaged_file
from labkit.plugins.exchange.packing import Answers, Packing
from labkit.process.extras import require_library

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkFieldData

WHAT = "VTK files"


class Vtk(Format):
    """A VTK file. Sizes are in an array named radius or diameter; ids and box are usually missing.

    A file of contacts has the grains of each contact in arrays such as id1 and id2 (`labkit paraview` names them
    first_grain and second_grain).
    """

    name = "vtk"
    description = "VTK file of points (.vtp, .vtu, .vtk)"
    endings = (".vtp", ".vtu", ".vtk")

    def recognises(self, file: Path, head: str) -> bool:
        return "<VTKFile" in head or head.startswith("# vtk DataFile")

    def read(self, file: Path, answers: Answers) -> Packing:
        position, arrays, _ = _read(file)
        columns = GRAIN.arrays({"position": position, **arrays}, file, renamed(GRAIN, answers.columns, arrays, file))
        return grains_from(columns, file)

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        _, _, arrays = _read(file)
        columns = CONTACT.arrays(arrays, file, renamed(CONTACT, answers.contact_columns, arrays, file))
        if "id1" not in columns:
            raise InputError(
                f"{file} does not name the grains of its lines: give --contact-columns, e.g. first_grain=id1,"
                "second_grain=id2,forceN=fn"
            )
        return contacts_from(columns, file)


def _read(file: Path) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Read (points, arrays of the points, arrays of the cells) from a VTK file. Raises InputError."""
    xml = require_library("vtkmodules.vtkIOXML", WHAT, "formats")
    legacy = require_library("vtkmodules.vtkIOLegacy", WHAT, "formats")
    with open(file, "rb") as handle:
        old = handle.read(5) == b"# vtk"
    reader = legacy.vtkGenericDataObjectReader() if old else xml.vtkXMLGenericDataObjectReader()
    if old:
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
        reader.ReadAllFieldsOn()
    core = require_library("vtkmodules.vtkCommonCore", WHAT, "formats")
    core.vtkObject.GlobalWarningDisplayOff()  # the error below replaces VTK's warning
    reader.SetFileName(str(file))
    reader.Update()
    data = reader.GetOutput()
    if data is None or not hasattr(data, "GetPoints") or data.GetPoints() is None:
        raise damaged_file(file, "it has no points")
    to_numpy = require_library("vtkmodules.util.numpy_support", WHAT, "formats").vtk_to_numpy
    position = np.array(to_numpy(data.GetPoints().GetData()), dtype=float)
    return position, _arrays(data.GetPointData(), to_numpy), _arrays(data.GetCellData(), to_numpy)


def _arrays(attributes: vtkFieldData, to_numpy: Callable[[object], np.ndarray]) -> dict[str, np.ndarray]:
    numbers = range(attributes.GetNumberOfArrays())
    named = {attributes.GetArrayName(number): attributes.GetArray(number) for number in numbers}  # None for text
    return {name: np.array(to_numpy(array), dtype=float) for name, array in named.items() if array is not None}
