"""The model along the path of a run: it must reproduce its own run files."""

import numpy as np
import pytest

import labkit
from analysis.paper.model_runs import CALIBRATED, TABLE_2, model_run, models, path_of, start_of
from labkit.cli.dispatch import main
from labkit.errors import InputError
from labkit.micro.stress import relative_error
from labkit.model.parameters import Model

pytestmark = pytest.mark.long

PATHS = {
    "cv": ["cv", "--void-ratio", 0.67, "--pressure", 3e5, "--strain", 0.1],
    "cp": ["cp", "--void-ratio", 0.65, "--pressure", 5e5, "--strain", 0.1],
    "cyclic": ["cyclic_cp", "--void-ratio", 0.7, "--pressure", 5e5, "--reversals", "0.01,-0.01,0.02"],
    "isod": ["isod", "--void-ratio", 0.65, "--pressure", 5e5, "--stop-pressure", 2e5],
}


@pytest.mark.parametrize("name", PATHS)
def test_reproduces_its_own_run(name, tmp_path):
    file = tmp_path / "model.run.nc"
    assert main(["model", *map(str, PATHS[name]), "-o", str(file)]) == 0
    run = labkit.open_run(file)
    again = model_run(run, Model())
    assert np.array_equal(again["axial_strain"], run["axial_strain"])
    assert relative_error(again["stress"].values, run["stress"].values).max() < 1e-6
    np.testing.assert_allclose(again["void_ratio"], run["void_ratio"], rtol=1e-9)


def test_starts_where_the_simulation_starts(run_file):
    run = labkit.open_run(run_file)
    state, again = start_of(run, Model(), path_of(run)), model_run(run, Model())
    assert state.e == run["void_ratio_nominal"][0] and state.Z == run["coordination_number"][0]
    p = again.lab.mean_stress()
    assert abs(p[0] / run.lab.mean_stress()[0] - 1.0) < 0.05  # C0 of about 300 grains
    assert again["axial_strain"][-1] == pytest.approx(0.02)


def test_calibrated_parameters(tmp_path):
    assert set(models(tmp_path)) == {TABLE_2}
    (tmp_path / "calibrated.json").write_text(Model().with_parameters(c_M=80.0).to_json())
    found = models(tmp_path)
    assert found[CALIBRATED].parameters.c_M == 80.0
    assert {model.readings.beyond_e_cmax for model in found.values()} == {"flat"}
    (tmp_path / "calibrated.json").write_text("{}")
    with pytest.raises(InputError, match=r"calibrated\.json"):
        models(tmp_path)
