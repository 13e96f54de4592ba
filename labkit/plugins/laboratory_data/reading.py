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
stresses, and both to compression positive. What was read is checked (`checks`) and summarised (`preview`).
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path as File
from typing import Literal

import numpy as np

from labkit.errors import InputError, instead_of, require_file_name, require_type
from labkit.grains.scene import Scene
from labkit.parameters import parameters_of
from labkit.paths.element_tests import Oedometer
from labkit.paths.path import Path
from labkit.paths.strain_measures import PURE_SHEAR, SHEAR
from labkit.plugins.laboratory_data.checks import findings_of, unit_findings
from labkit.plugins.laboratory_data.layout import Form, Separator
from labkit.plugins.laboratory_data.measured import Measured, held_by
from labkit.plugins.laboratory_data.table import LaboratoryColumns, read_laboratory_columns
from labkit.plugins.laboratory_data.units import read_unit
from labkit.results.endings import LABORATORY
from labkit.results.run import Run
from labkit.results.without_grains import MEASURED, complete_records, records_as_run, write_records
from labkit.text.foreign import require_accepted

Column = tuple[str, str | None, str] | tuple[str, str | None]  # header, unit (None: as in the file), positive sign
StrainKind = Literal["engineering", "logarithmic"]
StressKind = Literal["effective", "total"]

STRAINS = ("axial_strain", "volumetric_strain")
STRESSES = ("axial_stress", "radial_stress", "deviatoric_stress", "mean_stress")
UNSIGNED = ("pore_pressure", "void_ratio")
SIGNS = {"compression": 1.0, "tension": -1.0}
# Each stress as a combination of axial and radial stress: coefficients (axial, radial).
STRESS_ROWS = {
    "axial_stress": (1, 0),
    "radial_stress": (0, 1),
    "deviatoric_stress": (1, -1),
    "mean_stress": (1 / 3, 2 / 3),
}


def read_measured(
    file: str | os.PathLike[str],
    path: Path,
    columns: Mapping[str, Column],
    *,
    strain_kind: StrainKind,
    stress_kind: StressKind,
    source: str,
    licence: str,
    void_ratio: float | None = None,
    rows: Mapping[str, str] | None = None,
    group: str | None = None,
    header: int | None = None,
    separator: Separator | None = None,
    decimal: Literal["point", "comma"] | None = None,
    thousands: str | None = None,
    encoding: str | None = None,
    zero: Sequence[str] | None = None,
    accept: bool = False,
    name: str = "measured",
) -> Run:
    """Read a measured test as a Run whose engine is `laboratory`. Raises InputError for what is missing or unclear.

    Args:
        file: Text table, or AGS4 file if `group` is given.
        path: The path that repeats the test, with its pressure. Rows beyond the strain of the path are left out, and
            the path of the Run ends at the last row.
        columns: Quantity -> (header, unit, positive sign). Quantities are axial_strain, volumetric_strain (unless the
            path prescribes it or void_ratio shows it), void_ratio, pore_pressure (which r_u then uses), and two of
            axial_stress, radial_stress, deviatoric_stress (axial minus radial) and mean_stress; an oedometer test needs
            only axial_stress, and void_ratio or axial_strain. The sign, `compression` or `tension`, is left out for
            pore_pressure and void_ratio; the unit may be None if the file states it. `#3` instead of a header is the
            third column.
        strain_kind: `engineering` (change over initial size) or `logarithmic`.
        stress_kind: `effective` or `total`.
        source: Where the measurement was published.
        licence: Terms under which it may be used.
        void_ratio: Void ratio at the first row, if there is no such column.
        rows: Header -> value; only rows with these values are read, from a table of several tests.
        group: Group of an AGS4 file, such as CTRD.
        header: Line of the headers, from 1, if several lines have them: the table ends above the next of these lines.
        separator: Mark between columns, if it is not the one with which most cells are numbers: `comma`, `semicolon`,
            `tab`, `bar`, `blank` (one or more), or `blanks` (two or more, so that headers may have single ones).
        decimal: `point` or `comma`, if the numbers do not show their decimal mark.
        thousands: Mark between thousands, if it is neither a comma, a point, a blank nor an apostrophe.
        encoding: Encoding, if the file is neither UTF-8, UTF-16 nor Windows-1252, e.g. mac_roman or shift_jis.
        zero: Quantities that are counted from the first row: their first value is subtracted.
        accept: True to leave out rows that cannot be read, and to go on in spite of serious findings of the checks.
        name: Name of the test in figures.
    """
    require_file_name(file, "labkit.read_measured('test.csv', path, columns, ...)")
    _require_path(path)
    _require_columns(columns)
    form = Form(separator, decimal, thousands, encoding, header, rows or {}, group, accept)
    table = read_laboratory_columns(File(file), {header: unit for header, unit, *_ in columns.values()}, form)
    values, zeroed = _in_si(columns, table, zero or ())
    records = _records(path, values, strain_kind, stress_kind, void_ratio)
    pore_pressure = values["pore_pressure"] if stress_kind == "total" else 0.0
    test = Measured(path, table, columns, values, records, void_ratio, pore_pressure)
    findings = [*unit_findings(columns, table.units), *findings_of(test)]
    require_accepted(findings, accept, "reads")
    notes = [*table.notes, *(f"{quantity} counts from the first row" for quantity in zeroed), *map(str, findings)]
    records, path = _up_to_strain(records, path, notes)
    stored = dataclasses.asdict(path)
    attributes = {
        "engine": LABORATORY,
        "scene": Scene().to_json(),
        "path": path.name,
        "path_parameters": json.dumps({name: stored[name] for name in parameters_of(type(path))}),
        "complete": np.int32(1),
        "source": source,
        "licence": licence,
        "measured_columns": json.dumps({key: list(column) for key, column in columns.items()}),
        "measured_rows": json.dumps(_summary(File(file).name, table, columns, notes)),
        "test": name,
    }
    more = {name: variable for name, variable in MEASURED.items() if name in records}
    return Run(records_as_run(complete_records(records, len(records["time"])), attributes, more))


def _summary(
    file: str, table: LaboratoryColumns, columns: Mapping[str, Column], notes: Sequence[str]
) -> dict[str, str | int | list[int] | list[str] | dict[str, list[float | str]]]:
    """Return what `preview` needs."""
    ranges: dict[str, list[float | str]] = {}
    for quantity, (header, unit, *_) in columns.items():
        cells = table.values[header]
        ranges[quantity] = [header, unit or table.units[header], float(cells.min()), float(cells.max())]
    return {
        "file": file,
        "lines": [int(table.lines[0]), int(table.lines[-1])],
        "rows": len(table.lines),
        "columns": ranges,
        "unused": [*table.texts],
        "notes": list(notes),
    }


def preview(measured: Run) -> str:
    """Return what was read from a measured test's file: rows, ranges with units, columns that were not used, notes.

    Raises InputError for a run that was not read by `read_measured`.
    """
    if "measured_rows" not in measured.data.attrs:
        raise InputError("this run was not measured, or by an older version: give a test read by read_measured")
    read = json.loads(measured.data.attrs["measured_rows"])
    first, last = read["lines"]
    lines = [f"{read['file']}: {read['rows']} rows, lines {first} to {last}"]
    for quantity, (header, unit, low, high) in read["columns"].items():
        lines.append(f"  {quantity:18} {low:.6g} to {high:.6g} {unit:5} from {header!r}")
    lines += [f"  not used: {', '.join(read['unused'])}"] if read["unused"] else []
    return "\n".join([*lines, *(f"  note: {note}" for note in read["notes"])])


def _up_to_strain(records: dict[str, np.ndarray], path: Path, notes: list[str]) -> tuple[dict[str, np.ndarray], Path]:
    """Return the records up to the strain of the path, and the path up to the last of them, with a note."""
    if path.cyclic or path.has_programmes:  # their strain follows from their reversals, or steps
        return records, path
    within = np.abs(records["axial_strain"]) <= abs(path.strain) * (1.0 + 1e-9)
    if not within.any() or not records["axial_strain"][within].any():
        first = records["axial_strain"][~within][0] if not within.all() else 0.0
        text = f"all rows but the start are beyond the strain {path.strain:g} of the path ({first:.4g} follows)"
        if within.all():
            text = "the axial strain is 0 in every row"
        raise InputError(f"{text}: give a larger --strain, and check the unit of the axial strain")
    if not within.all():
        notes.append(
            f"{int((~within).sum())} rows beyond the strain {path.strain:g} of the path (logarithmic) are left out"
        )
    records = {field: column[within] for field, column in records.items()}
    if not records["axial_strain"][-1]:
        text = "the axial strain is 0 in the last row: are the rows in reverse order?"
        raise InputError(f"{text} Give a table that ends at the strain of the test")
    return records, dataclasses.replace(path, strain=float(records["axial_strain"][-1]))


def write_measured(measured: Run, file: str | os.PathLike[str], history: str = "") -> None:
    """Write a measured test as a run file, CF netCDF, with its source and licence. Raises OSError."""
    require_type(measured, Run, "measured", "the result of labkit.read_measured")
    require_file_name(file, "labkit.write_measured(measured, 'm.run.nc')")
    records = {str(name): variable.values for name, variable in measured.data.variables.items()}
    more = {name: variable for name, variable in MEASURED.items() if name in records}
    write_records(file, records, measured.data.attrs, "test measured in a laboratory", history, more)


def _require_path(path: Path) -> None:
    """Raise InputError for anything but a path whose strains columns describe."""
    require_type(path, Path, "path", "labkit.paths.ConstantRadialStress(pressure='100 kPa')")
    if path.strain_measure() in (SHEAR, PURE_SHEAR):
        text = f"the path {path.name} has a shear strain, which measured columns do not describe"
        raise InputError(f"{text}: give a triaxial or oedometer test, e.g. cr")


def _require_columns(columns: Mapping[str, Column]) -> None:
    """Raise InputError for an unknown quantity, a wrong sign and a column that is given twice."""
    for quantity, (header, unit, *sign) in columns.items():
        if quantity not in (quantities := (*STRAINS, *STRESSES, *UNSIGNED)):
            raise InputError(f"the column {quantity} is unknown: give {instead_of(quantities, quantity)}")
        if quantity in UNSIGNED and sign:
            right = f"{quantity}={header}:{unit or ''}"
            raise InputError(f"the column {quantity}={header}:{unit or ''}:{sign[0]} takes no sign: give {right}")
        if quantity not in UNSIGNED and (not sign or sign[0] not in SIGNS):
            text = "the header, the unit and its positive sign, `compression` or `tension`"
            problem = f"has the unknown sign {sign[0]!r}" if sign else "has no positive sign"
            raise InputError(f"the column {quantity}={header} {problem}: give {text}")
    headers = [column[0] for column in columns.values()]
    if twice := next((header for header in headers if headers.count(header) > 1), None):
        both = " and ".join(quantity for quantity, column in columns.items() if column[0] == twice)
        raise InputError(f"the column {twice!r} is given for {both}: give one column for each")


def _in_si(
    columns: Mapping[str, Column], table: LaboratoryColumns, zero: str | Sequence[str]
) -> tuple[dict[str, np.ndarray], Sequence[str]]:
    """Return quantity -> values, SI units, compression positive, and the quantities that count from the first row.

    Raises InputError for such a quantity without a column.
    """
    values = {name: _factor(name, column, table.units) * table.values[column[0]] for name, column in columns.items()}
    zero = [zero] if isinstance(zero, str) else zero
    for quantity in zero:
        if quantity not in columns or quantity == "void_ratio":
            allowed = f"some of {', '.join(name for name in columns if name != 'void_ratio')}"
            raise InputError("has no column", field="zero", value=quantity, allowed=allowed)
        values[quantity] = values[quantity] - values[quantity][0]
    return values, zero


def _factor(quantity: str, column: Column, units: Mapping[str, str]) -> float:
    """Return the factor from the numbers of a column to SI units, compression positive. Raises InputError."""
    header, unit, *sign = column
    unit = unit or units.get(header)
    if unit is None:
        right = f"{quantity}={header}:UNIT{':SIGN' * bool(sign)}"
        raise InputError(f"the column {quantity}={header} has no unit, nor does the file state it: give {right}")
    return read_unit(quantity, unit, quantity in (*STRAINS, "void_ratio")) * (SIGNS[sign[0]] if sign else 1.0)


def _records(
    path: Path,
    values: Mapping[str, np.ndarray],
    strain_kind: StrainKind,
    stress_kind: StressKind,
    void_ratio: float | None,
) -> dict[str, np.ndarray]:
    """Return the records that follow from the measurement, name -> array along time."""
    if strain_kind not in ("engineering", "logarithmic"):
        raise InputError(field="strain_kind", value=strain_kind, allowed="engineering or logarithmic")
    by_void_ratio = None
    if "void_ratio" in values:
        by_void_ratio = np.log((1.0 + values["void_ratio"][0]) / (1.0 + values["void_ratio"]))
    if "axial_strain" not in values and by_void_ratio is not None and isinstance(path, Oedometer):
        axial = by_void_ratio
    else:
        axial = _logarithmic(values, "axial_strain", strain_kind)
    if "volumetric_strain" in values:
        volumetric = _logarithmic(values, "volumetric_strain", strain_kind)
    elif isinstance(path, Oedometer):
        volumetric = axial
    elif any(condition.kind == "volume" for condition in held_by(path)):
        volumetric = np.zeros_like(axial)
    elif by_void_ratio is not None:
        volumetric = by_void_ratio
    else:
        volumetric = _require(values, "volumetric_strain")
    radial = 0.5 * (volumetric - axial)
    start = values["void_ratio"][0] if "void_ratio" in values else void_ratio
    if start is None:
        raise InputError("is missing", field="void_ratio", allowed="that of the first row, or a column of this name")
    if start <= -1.0 or not np.isfinite(start):
        raise InputError(field="void_ratio", value=start, allowed="a number above 0, e.g. 0.67")
    strain = np.transpose([radial, radial, axial])[:, :, None] * np.eye(3)
    stress = _stress(path, values, stress_kind)
    return {
        "time": np.arange(len(axial), dtype=float),
        "axial_strain": axial,
        "strain": strain,
        "cell": np.exp(-strain) * np.eye(3),
        "volume": np.exp(-volumetric),
        "stress": stress[:, :, None] * np.eye(3),
        "void_ratio": values.get("void_ratio", (1.0 + start) * np.exp(-(volumetric - volumetric[0])) - 1.0),
        **({"measured_pore_pressure": values["pore_pressure"]} if "pore_pressure" in values else {}),
    }


def _require(values: Mapping[str, np.ndarray], quantity: str) -> np.ndarray:
    if quantity not in values:
        sign = "" if quantity in UNSIGNED else ":SIGN"
        other = ", or void_ratio=HEADER:1" if quantity == "volumetric_strain" else ""
        raise InputError(f"the column {quantity} is missing: give {quantity}=HEADER:UNIT{sign}{other}")
    return values[quantity]


def _logarithmic(values: Mapping[str, np.ndarray], quantity: str, strain_kind: StrainKind) -> np.ndarray:
    """Return the logarithmic strain from a column, compression positive."""
    strain = _require(values, quantity)
    if strain_kind == "engineering" and strain.max() >= 1.0:
        text = f"the column {quantity} reaches {strain.max():.4g}, and an engineering strain is less than 1 (100 %)"
        raise InputError(f"{text}: give the unit %, if the file is in %, or --strain-kind logarithmic")
    return -np.log1p(-strain) if strain_kind == "engineering" else strain


def _stress(path: Path, values: Mapping[str, np.ndarray], stress_kind: StressKind) -> np.ndarray:
    """Return the effective stresses x, y, z in all rows, (n, 3), Pa; in an oedometer, the radial stress may be NaN."""
    stresses = {name: values[name] for name in STRESSES if name in values}
    if isinstance(path, Oedometer) and set(stresses) == {"axial_stress"}:
        axial, radial = stresses["axial_stress"], np.full_like(stresses["axial_stress"], np.nan)
    elif len(stresses) < 2:
        text = f"the columns have {'only ' * bool(stresses)}{', '.join(stresses) or 'no stress'}"
        raise InputError(f"{text}: give two of {', '.join(STRESSES)}")
    else:
        names = list(stresses)[:2]
        solved = np.linalg.solve([STRESS_ROWS[name] for name in names], np.array([stresses[name] for name in names]))
        axial, radial = solved
    if stress_kind == "total":
        pore_pressure = _require(values, "pore_pressure")
        axial, radial = axial - pore_pressure, radial - pore_pressure
    elif stress_kind != "effective":
        raise InputError(field="stress_kind", value=stress_kind, allowed="effective or total")
    return np.transpose([radial, radial, axial])
