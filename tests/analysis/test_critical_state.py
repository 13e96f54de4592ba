"""The critical state at large strain: what its data set keeps of a run."""

import pytest
import xarray as xr

import labkit as lk
from analysis.critical_state.study import STUDY
from labkit.micro import mean_stress

pytestmark = pytest.mark.long


def test_the_data_set_holds_what_the_runs_hold(tmp_path):
    """Records, and the equations related to C0 at the snapshots, whose errors add up to that of C0."""
    state = lk.make_specimen(lk.Recipe(0.67, grains=150, step1_friction=0.15), progress=False)
    path, file = lk.paths.SimpleShear(pressure=0.3e6, strain=0.03, rate=60.0), tmp_path / "shear-s1.run.nc"
    run = lk.run(state, path, file=file, snapshots=2, progress=False)
    STUDY.gather([file], tmp_path / STUDY.data, "a command")
    with xr.open_dataset(tmp_path / STUDY.data) as data:
        kept = data.sel(run="shear-s1").load()
    love = run.data["stress"].values
    assert kept["stress"].values[[0, -1]] == pytest.approx(love[[0, -1]], rel=1e-6)
    assert kept["accumulated_strain"].values[-1] == pytest.approx(0.03, rel=1e-2)
    assert str(kept["path"].values) == "simple_shear" and '"strain": 0.03' in str(kept["path_parameters"].values)
    error = kept["error_budget"].sum("part").values
    c0 = kept["stress_family"].sel(form="c0").values
    assert c0 - kept["snapshot_stress"].values == pytest.approx(error, abs=1e-4 * mean_stress(love[0]))
