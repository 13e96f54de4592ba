"""The same specimens on YADE, on the engine fused with YADE's law, and with the paper's: what comes out of each."""

from __future__ import annotations

import numpy as np
import pandas

from analysis.paper.ends import Runs, ends, matching
from labkit.runs import SHEAR

KINDS = {"yade": "YADE, law yade", "fused": "fused, law yade", "paper": "fused, law paper"}
TOLD = ("peak", "M", "e", "Z", "Lambda")


def engine_table(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per test and kind of KINDS, of the runs NAME-KIND.

    peak: the largest |q|/p; M, e, Z, Lambda: means over the last quarter of the strain of a monotonic shear
    test, of any other test those of its last record, M left out. off_*: by how much they differ from YADE's, relative.
    """
    rows = []
    for name, run in matching(runs, r"(share|full)_\w+-(yade|fused|paper)").items():
        test, kind = name.rsplit("-", 1)
        p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
        row = {"test": test, "kind": KINDS[kind], "grains": run.attrs["grains"]}
        row |= {"peak": float(np.max(np.abs(q) / p))} if run.attrs["path"] not in ("isoc", "isod") else {}
        rows.append(row | (_critical({name: run}) if run.attrs["path"] in SHEAR else _last(run)))
    table = pandas.DataFrame(rows, columns=["test", "kind", "grains", *TOLD]).sort_values(["test", "kind"])
    on_yade = table[table["kind"] == KINDS["yade"]].set_index("test")[list(TOLD)].reindex(table["test"]).to_numpy()
    off = pandas.DataFrame(
        table[list(TOLD)].to_numpy(dtype=float) / on_yade - 1.0, table.index, [f"off_{one}" for one in TOLD]
    )
    return pandas.concat([table, off], axis=1).reset_index(drop=True)


def _critical(runs):
    return ends(runs).iloc[0][list(TOLD[1:])].to_dict()


def _last(run):
    last = run.isel(time=-1)
    return {
        "e": float(last["void_ratio"]),
        "Z": float(last["coordination_number"]),
        "Lambda": float(last["mean_normalised_force"]),
    }
