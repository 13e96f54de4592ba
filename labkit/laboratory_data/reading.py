"""Measured tests as runs without grains: columns of a text table, or of a group of an AGS4 file.

    measured = labkit.read_measured(
        "tmd2.csv",
        labkit.paths.ConstantRadialStress(pressure="100 kPa", strain=0.2),
        columns={
            "axial_strain": ("eps1", "%", "compression"),
            "volumetric_strain": ("epsv", "%", "compression"),
            "axial_stress": ("s1", "kPa", "compression"),
            "radial_stress": ("s3", "kPa", "compression"),
        },
        strain_kind="engineering", stress_kind="effective", void_ratio=0.975, source="doi:...", licence="CC BY 4.0",
    )

`path` is the loading path that repeats the test on grains. labkit guesses nothing: headers, units, sign conventions,
and the types of strain and stress are arguments. Strains are converted to logarithmic strains, stresses to effective
stresses, and both to compression positive.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path as File
from typing import Literal, TypedDict, Unpack

import numpy as np

from labkit.errors import InputError, instead_of, require_file_name, require_type
from labkit.grains.scene import Scene
from labkit.io.foreign import cells, is_number
from labkit.parameters import Parameter, parameters_of
from labkit.paths.element_tests import Oedometer
from labkit.paths.path import Path
from labkit.runs.read.run import Run
from labkit.runs.read.without_grains import LABORATORY, complete_records, records_as_run, write_records

Column = tuple[str, str | None, str] | tuple[str, str | None]  # header, unit (None: from AGS4), positive sign
StrainKind = Literal["engineering", "logarithmic"]
StressKind = Literal["effective", "total"]

STRAINS = ("axial_strain", "volumetric_strain")
STRESSES = ("axial_stress", "radial_stress", "deviatoric_stress", "mean_stress")
UNSIGNED = ("pore_pressure", "void_ratio")
SIGNS = {"compression": 1.0, "tension": -1.0}
FACTORS = {"1": 1.0, "%": 0.01}  # units of strains and void ratios
PRESSURE = Parameter("unit", unit="Pa")
# Each stress as a combination of axial and radial stress: coefficients (axial, radial).
STRESS_ROWS = {
    "axial_stress": (1, 0),
    "radial_stress": (0, 1),
    "deviatoric_stress": (1, -1),
    "mean_stress": (1 / 3, 2 / 3),
}


class Needed(TypedDict):
    """Required arguments of read_measured: information that the file does not contain."""

    strain_kind: StrainKind
    stress_kind: StressKind
    source: str
    licence: str


class Description(Needed, total=False):
    """Arguments of read_measured, required and optional."""

    void_ratio: float | None
    rows: Mapping[str, str] | None
    group: str | None
    name: str


def read_measured(
    file: str | os.PathLike[str], path: Path, columns: Mapping[str, Column], **description: Unpack[Description]
) -> Run:
    """Read a measured test as a Run whose engine is `laboratory`. Raises InputError for what is missing or unclear.

    Args:
        file: Text table, or AGS4 file if `group` is given.
        path: The path that repeats the test, with its pressure. Rows beyond the strain of the path are left out, and
            the path of the Run ends at the last row.
        columns: Quantity -> (header, unit, positive sign). Quantities are axial_strain, volumetric_strain (unless the
            path prescribes it), void_ratio, pore_pressure (for total stresses), and two of axial_stress, radial_stress,
            deviatoric_stress (axial minus radial) and mean_stress; an oedometer test needs only axial_stress, and
            void_ratio or axial_strain. The sign, `compression` or `tension`, is left out for pore_pressure and
            void_ratio; the unit may be None for AGS4.
        strain_kind: `engineering` (change over initial size) or `logarithmic`.
        stress_kind: `effective` or `total`.
        source: Where the measurement was published.
        licence: Terms under which it may be used.
        void_ratio: Void ratio at the first row, if there is no such column.
        rows: Header -> value; only rows with these values are read, from a table of several tests.
        group: Group of an AGS4 file, such as CTRD.
        name: Name of the test in figures.
    """
    require_file_name(file, "labkit.read_measured('test.csv', path, columns, ...)")
    require_type(path, Path, "path", "labkit.paths.ConstantRadialStress(pressure='100 kPa')")
    _require_words(description)
    wanted, rows = [one[0] for one in columns.values()], description.get("rows") or {}
    table, units = _table(File(file), [*wanted, *rows], description.get("group"))
    keep = np.all([table[header] == value for header, value in rows.items()], axis=0) if rows else slice(None)
    values = {
        quantity: _in_si(quantity, column, _numbers(table[column[0]][keep], column[0], file), units)
        for quantity, column in columns.items()
    }
    if not len(next(iter(values.values()), ())):
        raise InputError(f"{file} has no rows with {dict(rows)}: give values of its column")
    known = _records(path, values, description)
    if not path.cyclic:  # whichever is longer, path or measurement, is cut
        kept = np.abs(known["axial_strain"]) <= abs(path.strain) * (1.0 + 1e-9)
        known = {field: column[kept] for field, column in known.items()}
        path = dataclasses.replace(path, strain=float(known["axial_strain"][-1]))
    attributes = {
        "engine": LABORATORY,
        "scene": Scene().to_json(),
        "path": path.name,
        "path_parameters": json.dumps({field: getattr(path, field) for field in parameters_of(type(path))}),
        "complete": np.int32(1),
        "source": description["source"],
        "licence": description["licence"],
        "measured_columns": json.dumps({key: list(column) for key, column in columns.items()}),
        "test": description.get("name", "measured"),
    }
    return Run(records_as_run(complete_records(known, len(known["time"])), attributes))


def _require_words(given: Mapping[str, object]) -> None:
    """Raise InputError for a keyword of read_measured that does not exist, or that is missing."""
    for name in given.keys() - (known := Description.__annotations__).keys():
        raise InputError("is not an argument of labkit.read_measured", field=name, allowed=instead_of(known, name))
    for name in Description.__required_keys__ - given.keys():
        raise InputError("is an argument that labkit.read_measured needs", field=name, allowed=f"{name}=...")


def write_measured(measured: Run, file: str | os.PathLike[str], history: str = "") -> None:
    """Write a measured test as a run file, CF netCDF, with its source and licence. Raises OSError."""
    require_type(measured, Run, "measured", "the result of labkit.read_measured")
    require_file_name(file, "labkit.write_measured(measured, 'm.run.nc')")
    records = {str(name): variable.values for name, variable in measured.data.variables.items()}
    write_records(file, records, measured.data.attrs, "test measured in a laboratory", history)


def _table(file: File, headers: Sequence[str], group: str | None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return columns as text, header -> (n,), and the units of the columns in an AGS4 file."""
    if not file.is_file():
        raise InputError(f"{file} does not exist: give the file of a measured test")
    if group is not None:
        return _ags4(file, headers, group)
    lines = [line for line in file.read_text(errors="replace").splitlines() if line.strip()]
    rows = list(map(cells, lines))
    start = next((k for k, row in enumerate(rows) if set(headers) <= set(row)), None)
    if start is None:
        raise InputError(f"{file} has no line with the headers {', '.join(headers)}: give them as they are in the file")
    width = len(rows[start])
    body = [row for row in rows[start + 1 :] if len(row) == width and any(map(is_number, row))]
    return {header: np.array([row[rows[start].index(header)] for row in body]) for header in headers}, {}


def _ags4(file: File, headers: Sequence[str], group: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return columns of a group in an AGS4 file, and their units."""
    try:
        from python_ags4 import AGS4
    except ImportError:
        raise InputError("AGS4 needs the package python-ags4: pip install 'labkit[laboratory]'") from None
    groups, known = AGS4.AGS4_to_dataframe(str(file))
    if group not in groups:
        raise InputError(f"{file} has no group {group}: give one of {', '.join(groups)}")
    lacking = [header for header in headers if header not in known[group]]
    if lacking:
        raise InputError(f"the group {group} of {file} has no {lacking[0]}: give one of {', '.join(known[group][1:])}")
    table = groups[group]
    units = table[table["HEADING"] == "UNIT"].iloc[0]
    data = table[table["HEADING"] == "DATA"]
    return {header: data[header].to_numpy(dtype=str) for header in headers}, {h: units[h] or "1" for h in headers}


def _numbers(texts: np.ndarray, header: str, file: str | os.PathLike[str]) -> np.ndarray:
    if wrong := [text for text in texts if not is_number(text)]:
        raise InputError(f"{file}: {header} has {wrong[0]!r}, not a number: repair the table, or choose rows")
    return texts.astype(float)


def _in_si(quantity: str, column: Column, values: np.ndarray, units: Mapping[str, str]) -> np.ndarray:
    """Convert a column to SI units, compression positive. Raises InputError."""
    header, unit, *sign = column
    if quantity not in (known := (*STRAINS, *STRESSES, *UNSIGNED)):
        raise InputError(field="columns", value=quantity, allowed=f"one of {', '.join(known)}")
    unit = unit or units.get(header)
    if unit is None:
        raise InputError("has no unit", field=quantity, value=header, allowed="the header, the unit and the sign")
    if (quantity in UNSIGNED) == bool(sign) or (sign and sign[0] not in SIGNS):
        needed = "no sign" if quantity in UNSIGNED else "its positive sign, `compression` or `tension`"
        raise InputError(field=quantity, value=header, allowed=f"the header, the unit and {needed}")
    if quantity in (*STRAINS, "void_ratio"):
        if unit not in FACTORS:
            raise InputError("is not a unit of strain", field=quantity, value=unit, allowed="1 or %")
        factor = FACTORS[unit]
    else:
        factor = PRESSURE.read(f"1 {unit}")
    return factor * (SIGNS[sign[0]] if sign else 1.0) * values


def _records(path: Path, values: Mapping[str, np.ndarray], description: Description) -> dict[str, np.ndarray]:
    """Return the records that follow from the measurement, name -> array along time."""
    strain_kind, void_ratio = description["strain_kind"], description.get("void_ratio")
    if strain_kind not in ("engineering", "logarithmic"):
        raise InputError(field="strain_kind", value=strain_kind, allowed="engineering or logarithmic")
    if "axial_strain" not in values and "void_ratio" in values and isinstance(path, Oedometer):
        axial = np.log((1.0 + values["void_ratio"][0]) / (1.0 + values["void_ratio"]))
    else:
        axial = _logarithmic(values, "axial_strain", strain_kind)
    if "volumetric_strain" not in values and isinstance(path, Oedometer):
        volumetric = axial
    elif "volumetric_strain" not in values and any(held.kind == "volume" for held in path.held()):
        volumetric = np.zeros_like(axial)
    else:
        volumetric = _logarithmic(values, "volumetric_strain", strain_kind)
    radial = 0.5 * (volumetric - axial)
    start = values["void_ratio"][0] if "void_ratio" in values else void_ratio
    if start is None:
        raise InputError("is missing", field="void_ratio", allowed="that of the first row, or a column of this name")
    strain = np.transpose([radial, radial, axial])[:, :, None] * np.eye(3)
    stress = _stress(path, values, description["stress_kind"])
    return {
        "time": np.arange(len(axial), dtype=float),
        "axial_strain": axial,
        "strain": strain,
        "cell": np.exp(-strain) * np.eye(3),
        "volume": np.exp(-volumetric),
        "stress": stress[:, :, None] * np.eye(3),
        "void_ratio": values.get("void_ratio", (1.0 + start) * np.exp(-(volumetric - volumetric[0])) - 1.0),
    }


def _require(values: Mapping[str, np.ndarray], quantity: str) -> np.ndarray:
    if quantity not in values:
        raise InputError("is missing", field=quantity, allowed="a column: its header, its unit and its positive sign")
    return values[quantity]


def _logarithmic(values: Mapping[str, np.ndarray], quantity: str, strain_kind: StrainKind) -> np.ndarray:
    """Return the logarithmic strain from a column, compression positive."""
    strain = _require(values, quantity)
    return -np.log1p(-strain) if strain_kind == "engineering" else strain


def _stress(path: Path, values: Mapping[str, np.ndarray], stress_kind: StressKind) -> np.ndarray:
    """Return the effective stresses x, y, z in all rows, (n, 3), Pa; in an oedometer, the radial stress may be NaN."""
    given = {name: values[name] for name in STRESSES if name in values}
    if isinstance(path, Oedometer) and set(given) == {"axial_stress"}:
        axial, radial = given["axial_stress"], np.full_like(given["axial_stress"], np.nan)
    elif len(given) < 2:
        raise InputError(field="columns", value=", ".join(given), allowed=f"two of {', '.join(STRESSES)}")
    else:
        names = list(given)[:2]
        solved = np.linalg.solve([STRESS_ROWS[name] for name in names], np.array([given[name] for name in names]))
        axial, radial = solved
    if stress_kind == "total":
        pore_pressure = _require(values, "pore_pressure")
        axial, radial = axial - pore_pressure, radial - pore_pressure
    elif stress_kind != "effective":
        raise InputError(field="stress_kind", value=stress_kind, allowed="effective or total")
    return np.transpose([radial, radial, axial])
