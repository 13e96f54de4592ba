"""The tables in results/paper follow from the runs stored there; those of the model take minutes and are left out."""

from pathlib import Path

import pandas
import pytest

import analysis.paper
from analysis.paper.ends import ends, extrapolated, in_memory, main, sheared
from analysis.paper.engines import engine_table
from analysis.paper.lines import critical_lines, off_the_lines, one_line
from analysis.paper.sff_errors import c0_bias, c0_errors, sff_errors
from analysis.paper.stationarity import components, stationarity
from analysis.places import results_folder

pytestmark = pytest.mark.long

RESULTS = Path(results_folder("paper"))


def tables_of(runs, known):
    """Name -> table. `known`: the records of the runs, in memory."""
    tests = sheared(main(known))
    at_ends, (slopes, drifts), of_c0 = off_the_lines(ends(tests)), stationarity(tests), c0_errors(main(known))
    return {
        "critical_states": at_ends,
        "critical_extrapolated": extrapolated(tests),
        "critical_lines": critical_lines(at_ends),
        "one_critical_line": one_line(at_ends),
        "components": components(at_ends),
        "slopes": slopes,
        "stationarity": drifts,
        "c0_errors": of_c0,
        "c0_bias": c0_bias(of_c0),
        "sff": sff_errors(runs),
        "engines": engine_table(known),
    }


def test_the_stored_tables_follow_from_the_stored_runs():
    runs = analysis.paper.runs(RESULTS)
    for name, table in tables_of(runs, in_memory(runs)).items():
        stored = pandas.read_csv(RESULTS / f"{name}.csv")
        found = table[[*stored]].reset_index(drop=True)
        for column in stored.select_dtypes(exclude="number"):
            assert found[column].fillna("").tolist() == stored[column].fillna("").tolist(), (name, column)
            found[column] = stored[column]
        pandas.testing.assert_frame_equal(found.astype(stored.dtypes), stored, rtol=1e-4, atol=1e-6, obj=name)
