"""A predicted test as AGS4 4.1.1, whose curves with intervals are a group of its own, TREP."""

from __future__ import annotations

import datetime
import math
import types
from pathlib import Path as File

import numpy as np
import pandas

from labkit.errors import InputError
from labkit.paths.path import Path
from labkit.plugins.laboratory_data.sheet import LIMITS, Prediction
from labkit.process.extras import require_library
from labkit.version import __version__

TESTS = {"cr": "CID", "cv": "CIU"}  # path -> start of TREG_TYPE
GROUP = "TREP"  # AGS4 has no group for curves of static tests, nor for intervals
HEADINGS = pandas.DataFrame(  # of this group, as in the dictionary of AGS4
    [
        ("TREP_QNTY", "KEY", "X", "Quantity", ""),
        ("TREP_STRN", "KEY", "2DP", "Axial strain, logarithmic, compression positive", "%"),
        ("TREP_MEAN", "OTHER", "4DP", "Predicted value of the quantity", ""),
        ("TREP_LOW", "OTHER", "4DP", "Lower end of the 90 % interval", ""),
        ("TREP_HIGH", "OTHER", "4DP", "Upper end of the 90 % interval", ""),
    ],
    columns=["DICT_HDNG", "DICT_STAT", "DICT_DTYP", "DICT_DESC", "DICT_UNIT"],
).set_index("DICT_HDNG")
SPECIMEN = {"LOCA_ID": "GRAINS", "SAMP_TOP": "0.00", "SAMP_REF": "1", "SAMP_TYPE": "", "SAMP_ID": "PREDICTED"}
Records = list[dict[str, str]]  # rows of a group: heading -> text


def require_ags4(path: Path) -> types.ModuleType:
    """Return the library that writes AGS4. Raises InputError without it, and for a path without a type in AGS4."""
    if path.name not in TESTS:
        raise InputError("has no type of test", field="ags4", value=path.name, allowed="a test on the path cr or cv")
    return require_library("python_ags4.AGS4", "AGS4 files", "ags4")


def write_ags4(prediction: Prediction, file: str) -> None:
    """Write the prediction as AGS4. Raises InputError (`require_ags4`)."""
    ags4 = require_ags4(prediction.path)
    dictionary, _ = ags4.AGS4_to_dataframe(File(str(ags4.__file__)).with_name("Standard_dictionary_v4_1_1.ags"))
    tables = _tables(_groups(prediction), dictionary)
    ags4.dataframe_to_AGS4(tables, {group: list(table) for group, table in tables.items()}, file, warnings=False)


def _groups(prediction: Prediction) -> dict[str, Records]:
    """Return the groups of the test, without those that describe headings, units and codes."""
    kind = f"{TESTS[prediction.path.name]}{'C' if prediction.path.strain > 0.0 else 'E'}"
    specimen = {**SPECIMEN, "SPEC_REF": "1", "SPEC_DPTH": "0.00"}
    pressure = math.nan if (start := prediction.path.start_pressure()) is None else start / 1e3
    test = {"TRET_CONP": f"{pressure:.0f}", "TRET_REM": f"predicted, see {GROUP}"}
    transmission = {
        **{"TRAN_ISNO": "1", "TRAN_DATE": f"{datetime.date.today()}", "TRAN_PROD": f"labkit {__version__}"},
        **{"TRAN_STAT": "Predicted", "TRAN_DESC": "Predicted by grains, not measured", "TRAN_AGS": "4.1.1"},
        **{"TRAN_RECV": "Designer", "TRAN_DLIM": "|", "TRAN_RCON": "+", "TRAN_REM": LIMITS},
    }
    curves = [
        (quantity, f"{100.0 * strain:.2f}", *(f"{value:.4f}" for value in values))
        for quantity, strain, *values in prediction.table(tuple(np.linspace(0.1, 1.0, 10))).itertuples(index=False)
    ]
    return {
        "PROJ": [{"PROJ_ID": "LABKIT", "PROJ_NAME": prediction.title}],
        "TRAN": [transmission],
        "LOCA": [{"LOCA_ID": "GRAINS", "LOCA_REM": "no location: grains"}],
        "SAMP": [{**SPECIMEN, "SAMP_REM": "no sample: grains"}],
        "TREG": [{**specimen, "TREG_TYPE": kind, "TREG_REM": "predicted, not measured", "TEST_STAT": "Predicted"}],
        "TRET": [{**specimen, "TRET_TESN": "1", **test, "TRET_IVR": f"{prediction.void_ratio:.3f}"}],
        GROUP: [{**specimen, "TRET_TESN": "1", **dict(zip(HEADINGS.index, row, strict=True))} for row in curves],
    }


def _tables(of: dict[str, Records], dictionary: dict[str, pandas.DataFrame]) -> dict[str, pandas.DataFrame]:
    """Return the groups as tables, with those that describe them; what they say is in the dictionary, or HEADINGS."""
    standard = dictionary["DICT"].query("DICT_TYPE == 'HEADING'").drop_duplicates("DICT_HDNG").set_index("DICT_HDNG")
    headings = pandas.concat([standard.assign(DICT_STAT="KEY")[HEADINGS.columns], HEADINGS])
    kind, unit = headings["DICT_DTYP"], headings["DICT_UNIT"]
    title = {"DICT_TYPE": "GROUP", "DICT_GRP": GROUP, "DICT_HDNG": "", **dict.fromkeys(HEADINGS.columns, "")}
    title |= {"DICT_DESC": "Triaxial Tests - Predicted Curves with Intervals", "DICT_PGRP": "TRET"}
    rows = [{"DICT_HDNG": name, **headings.loc[name], "DICT_PGRP": ""} for name in of[GROUP][0]]
    of = {**of, "DICT": [title, *({**title, "DICT_TYPE": "HEADING", **_plain(row)} for row in rows)]}
    cells = {(name, value) for records in of.values() for row in records for name, value in row.items() if value}
    codes = dictionary["ABBR"].set_index(["ABBR_HDNG", "ABBR_CODE"])["ABBR_DESC"].to_dict()
    coded = sorted(cell for cell in cells if kind[cell[0]] == "PA")
    of["ABBR"] = [{"ABBR_HDNG": name, "ABBR_CODE": code, "ABBR_DESC": codes[name, code]} for name, code in coded]
    names = [*{name for records in of.values() for name in records[0]}, "UNIT_UNIT"]  # in TYPE and UNIT, X too
    for group, used, listed in (("TYPE", kind, "PT"), ("UNIT", unit, "PU")):
        words = {*used[names], *(value for name, value in cells if kind[name] == listed)} - {""}
        described = dictionary[group].set_index(f"{group}_{group}")[f"{group}_DESC"].to_dict()
        of[group] = [_plain({f"{group}_{group}": word, f"{group}_DESC": described[word]}) for word in sorted(words)]
    return {group: _table(records, headings) for group, records in of.items()}


def _table(records: Records, headings: pandas.DataFrame) -> pandas.DataFrame:
    """Return a group as a table: a row of units, one of types, and the data."""
    data = pandas.DataFrame(records)
    above = headings.loc[[*data], ["DICT_UNIT", "DICT_DTYP"]].T.set_axis(["UNIT", "TYPE"])
    return pandas.concat([above, data.set_axis(["DATA"] * len(data))]).rename_axis("HEADING").reset_index()


def _plain(row: dict[str, str]) -> dict[str, str]:
    """Return a row without the line ends of the dictionary."""
    return {name: " ".join(text.split()) for name, text in row.items()}
