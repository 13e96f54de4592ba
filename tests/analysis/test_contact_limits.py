"""The readings of the limits of Eqs. 2 and 3: planted differences, and values of real runs."""

import shutil
from pathlib import Path

import numpy as np
import pandas
import pytest

from analysis.contact_limits.study import PLANNED, SECOND, STUDY, WINDOWS, differences, offsets
from analysis.paper.lines import critical_Z
from analysis.places import results_folder

pytestmark = pytest.mark.long


def planted(lower):
    """Thirteen pairs at e = 0.67 with the paper's Z, which `forces` lowers; both packings of a pair are the same."""
    rng = np.random.default_rng(3)
    rows = []
    for seed in range(13):
        packing = rng.normal(0.0, 0.02)
        for reading in ("springs", "forces"):
            for window in WINDOWS:
                Z_off = packing + rng.normal(0.0, 0.005) - lower * (reading == "forces")
                values = {name: 1.0 + rng.normal(0.0, 0.002) for name in SECOND}
                rows.append({"reading": reading, "specimen": seed, "window": window, "Z_off": Z_off, **values})
    table = pandas.DataFrame(rows)
    return table.assign(Z=table["Z_off"] + float(critical_Z(0.67)))


@pytest.mark.parametrize("lower", [0.06, 0.0])
def test_a_planted_difference_of_the_readings_is_found_and_none_is_invented(lower):
    found = differences(planted(lower)).set_index(["comparison", "quantity", "window"])
    asked = found.loc[1, "Z", PLANNED]
    assert abs(asked["difference"] + lower) < 2.0 * asked["within"] < 0.02 and asked["specimens"] == 13
    assert (asked["resolved"], asked["equivalent"]) == (lower > 0.0, lower == 0.0)
    assert not found.loc[2]["resolved"].any() and found.loc[2]["equivalent"].all() and len(found.loc[4]) == 2
    verdicts = offsets(planted(lower)).set_index("reading")["verdict"].to_dict()
    assert verdicts == {"springs": "agrees", "forces": "differs" if lower else "agrees"}


def test_values_are_gathered_from_runs(tmp_path):
    run = Path(results_folder("paper")) / "runs" / "cv-medium.run.nc"
    files = [tmp_path / f"cv-{reading}-s1.run.nc" for reading in ("springs", "forces")]
    for file in files:
        shutil.copy(run, file)
    STUDY.gather(files, tmp_path / STUDY.data, "a command")
    values = STUDY.read(tmp_path / STUDY.data)
    assert len(values) == 2 * len(WINDOWS) and set(values["specimen"]) == {"s1"}
    assert (values["strain"][values["window"] == PLANNED] - 0.35).abs().max() < 1e-3
    assert differences(values)["difference"].abs().max() == 0.0
