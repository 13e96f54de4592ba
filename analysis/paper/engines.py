"""Results of the same specimens in YADE, in the fused engine with YADE's contact law, and with the paper's law."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from analysis.paper.ends import Runs, ends, matching
from labkit.results import SHEAR

KINDS = {"yade": "YADE, rolling resistance", "paper": "fused, spring-dashpot", "fused": "fused, rolling resistance"}
COMPARED = ("peak", "M", "e", "Z", "Lambda")


def engine_table(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per test and kind of KINDS, from the runs NAME-KIND.

    `peak` is the largest |q|/p. M, e, Z and Lambda are means over the last quarter of the strain of a monotonic shear
    test; for any other test, e, Z and Lambda come from its last record. `off_*` are relative differences from YADE.
    """
    rows = []
    for name, run in matching(runs, r"(share|full)_\w+-(yade|fused|paper)").items():
        test, kind = name.rsplit("-", 1)
        p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
        row = {"test": test, "kind": KINDS[kind], "grains": run.attrs["grains"], "order": list(KINDS).index(kind)}
        row |= {"peak": float(np.max(np.abs(q) / p))} if run.attrs["path"] not in ("isoc", "isod") else {}
        rows.append(row | (_critical({name: run}) if run.attrs["path"] in SHEAR else _last(run)))
    compared = list(COMPARED)
    table = pandas.DataFrame(rows, columns=["test", "kind", "grains", "order", *compared])
    table = table.sort_values(["test", "order"]).drop(columns="order")
    on_yade = table[table["kind"] == KINDS["yade"]].set_index("test")[compared].reindex(table["test"]).to_numpy()
    off = pandas.DataFrame(
        table[compared].to_numpy(dtype=float) / on_yade - 1.0, table.index, [f"off_{name}" for name in compared]
    )
    return pandas.concat([table, off], axis=1).reset_index(drop=True)


def _critical(runs: Runs) -> dict[str, float]:
    return ends(runs).iloc[0][list(COMPARED[1:])].to_dict()


def _last(run: xr.Dataset) -> dict[str, float]:
    last = run.isel(time=-1)
    return {
        "e": float(last["void_ratio"]),
        "Z": float(last["coordination_number"]),
        "Lambda": float(last["mean_normalised_force"]),
    }
