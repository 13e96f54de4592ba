"""All tests as one data set, and as one table of states, their candidates and their rates."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import xarray as xr

from analysis.hidden_state.records import SCALARS, SIX, Records
from analysis.netcdf import write_data
from labkit.process import reporter

TRAINING = (1, 2)  # seeds; the others of loading.SEEDS are HELD_OUT
SPAN = 0.002  # norm of the deviatoric strain over which rates are measured
STRAIGHT = 0.9  # least net strain over its path length
EXACT = ("strain", "along", "e")
FABRIC, DIGITS = ("stress", "A", "F", "Ft", "Z", "Lambda"), (9, 6)  # columns, and significant bits: theirs, of others
THIN = ("shear", "undrained")  # and the tests of hidden_fabric.md
FINEST = 2.0**-21  # unit of the EXACT columns
STATE = ("e", "Z", "Lambda", "A", "F", "Ft")
CANDIDATES = ("sliding", "strong", "young", "mobilisation", "spread", "rolling", "variation")
RATES = ("D", "dZ", "dLambda", "dA", "dF", "dFt")
CYCLES, FIRST_SHEAR = ("small", "large", "loops", "back"), ("compression", "extension", "pre")
HELD_PRESSURE = (*CYCLES, *FIRST_SHEAR, "turn", "again")


@dataclasses.dataclass(frozen=True)
class Test:
    """A test: its labels, and its columns (records.SIX, records.SCALARS, `section`) in double precision."""

    name: str
    density: str
    seed: int
    columns: dict[str, np.ndarray]
    inertial: float
    ended: str

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["e"])

    @property
    def packing(self) -> str:
        """Name of the specimen."""
        return f"{self.density}-s{self.seed}"


def gather(folder: Path, file: Path, command: str) -> None:
    """Write the files of a folder (loading) as one netCDF file, with as many bits as the columns need."""
    files = sorted(folder.glob("*-s[0-9].npz"))
    progress, found = reporter("reading"), []
    for k, one in enumerate(files):
        found.append(thinned(Records.load(one), one.stem))
        progress(k / len(files), one.stem)
    columns: dict[str, tuple[Any, np.ndarray]] = {
        name: ("record", np.concatenate([one.columns[name] for one in found])) for name in (*SCALARS, "section")
    }
    columns |= {name: (("record", "component"), np.concatenate([one.columns[name] for one in found])) for name in SIX}
    for name in {*columns} - {*EXACT, "section"}:
        columns[name] = columns[name][0], rounded(columns[name][1], DIGITS[name not in FABRIC])
    for name in EXACT:
        columns[name] = columns[name][0], (np.round(columns[name][1] / FINEST) * FINEST).astype("f4")
    data = xr.Dataset(columns)
    data["row_size"] = "test", np.array([len(one) for one in found], np.int32)
    data["inertial"] = "test", np.array([one.inertial for one in found], np.float32)
    data["ended"] = "test", [one.ended for one in found]
    data["name"] = "test", [one.stem for one in files]
    data.attrs = {
        "title": "Reversals, rotation and reloading of 1,000 spheres: state, stress, strain, candidates for memory",
        "license": "CC BY 4.0",
        "units": "stress Pa, all else 1; compression positive, z axial; tensors in Mandel notation",
    }
    write_data(file, data, command)


def thinned(records: Records, name: str) -> Records:
    """Every fourth record of tests from which few numbers are taken (THIN), and that of the least mean stress."""
    if not name.startswith(THIN) and "_compression" not in name and "_extension" not in name:
        return records
    p = records.columns["stress"][:, :3].sum(axis=1)
    chosen = np.unique([*range(0, len(records), 4), int(p.argmin()), len(records) - 1])
    return dataclasses.replace(records, columns={key: values[chosen] for key, values in records.columns.items()})


def rounded(values: np.ndarray, digits: int) -> np.ndarray:
    """Single-precision values with some significant bits, which compress well."""
    bits = values.astype("f4").view(np.uint32)
    drop = np.uint32(23 - digits)
    half = np.uint32(1 << (int(drop) - 1))
    return (((bits + half) >> drop) << drop).view(np.float32)


def read(file: Path) -> list[Test]:
    """The tests of the data set."""
    data = xr.load_dataset(file)
    ends = np.cumsum(data["row_size"].values.astype(int))
    tests = []
    for k, end in enumerate(ends):
        rows = slice(end - int(data["row_size"].values[k]), end)
        columns = {name: data[name].values[rows].astype(float) for name in (*SIX, *SCALARS)}
        columns["section"] = data["section"].values[rows].astype(int)
        name, density, seed = str(data["name"].values[k]).rsplit("-", 2)
        ended = str(data["ended"].values[k])
        inertial = float(data["inertial"].values[k])
        tests.append(Test(name.replace("_", " "), density, int(seed[1:]), columns, inertial, ended))
    return tests


def tensor(six: np.ndarray) -> np.ndarray:
    """The tensor (3, 3) of six numbers in Mandel notation."""
    off = six[3:] / np.sqrt(2.0)
    return np.array([[six[0], off[2], off[1]], [off[2], six[1], off[0]], [off[1], off[0], six[2]]])


def deviatoric(six: np.ndarray) -> np.ndarray:
    """Deviatoric part of tensors (n, 6) in Mandel notation."""
    off = six.copy()
    off[..., :3] -= six[..., :3].mean(axis=-1, keepdims=True)
    return off


def kind_of(test: str, section: int) -> str:
    """The kind of history of a record."""
    if test.startswith("again"):
        return "after a pre-shear"
    if test.startswith("turn"):
        return "rotation"
    return "cycles" if section > 0 or test.startswith("back") else "monotonic"


def intervals(test: Test) -> Iterator[tuple[int, int]]:
    """Pairs of records, of one section, between which the strain is SPAN or a little more."""
    along, section = test["along"], test["section"]
    for k in range(len(test)):
        end = int(np.searchsorted(along, along[k] + SPAN))
        same = end < len(test) and section[end] == section[min(k + 1, len(test) - 1)]
        if same and along[end] - along[k] < 2.0 * SPAN:
            yield k, end


def rows_of(test: Test) -> list[dict[str, object]]:
    """A row per record whose following strain is SPAN: labels, state, candidates, direction `n`, rates."""
    rows = []
    for k, end in intervals(test):
        step = test["strain"][end] - test["strain"][k]
        off = deviatoric(step)
        size, path = float(np.linalg.norm(off)), float(test["along"][end] - test["along"][k])
        if size < STRAIGHT * path:
            continue
        change = {f"d{name}": (test[name][end] - test[name][k]) / size for name in STATE[1:]}
        row = {name: test[name][k] for name in (*STATE, *CANDIDATES, "stress", "new")}
        row |= {"D": step[:3].sum() / size, "n": off / size, **change, "record": k, "test": test.name}
        kind = kind_of(test.name, int(test["section"][end]))
        rows.append(row | {"kind": kind, "density": test.density, "seed": test.seed, "packing": test.packing})
    return rows


def states_of(tests: list[Test]) -> pandas.DataFrame:
    """The rows of all tests in which the mean stress is held."""
    held = [test for test in tests if test.name.startswith(HELD_PRESSURE) and " c" not in test.name]
    return pandas.DataFrame([row for test in held if " ext" not in test.name for row in rows_of(test)])


def stacked(rows: pandas.DataFrame, name: str) -> np.ndarray:
    """A column of scalars (n, 1) or tensors (n, 6)."""
    return np.array(rows[name].tolist(), float).reshape(len(rows), -1)


def along_direction(rows: pandas.DataFrame, name: str) -> np.ndarray:
    """The scalar form of a column, (n,): T:n for a tensor."""
    values = stacked(rows, name)
    return values[:, 0] if values.shape[1] == 1 else np.einsum("ni,ni->n", values, stacked(rows, "n"))
