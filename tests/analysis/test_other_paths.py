"""The study of other paths: its data set, its errors of C0 and its strengths, from small runs."""

import numpy as np
import pandas
import pytest
import xarray

import labkit as lk
from analysis.other_paths.errors import REFERENCE, comparison, direction, errors_of
from analysis.other_paths.strength import matsuoka_nakai, principal_stresses
from analysis.other_paths.study import STUDY
from labkit.micro import equivalent_stress, mean_stress

pytestmark = pytest.mark.long

PATHS = {
    "compression": lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.02, rate=60.0),
    "extension": lk.paths.ConstantMeanStress(pressure=0.3e6, strain=-0.02, rate=60.0),
    "shear": lk.paths.SimpleShear(pressure=0.3e6, strain=0.03, rate=60.0),
}
LOVE = np.array([[0.8e6, 0.1e6, 0.2e6], [0.1e6, 0.9e6, 0.0], [0.2e6, 0.0, 1.3e6]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results of a study with two specimens of 150 grains and three tests."""
    folder, files = tmp_path_factory.mktemp("study"), []
    for seed in (1, 2):
        recipe = lk.Recipe(void_ratio=0.67, grains=150, seed=seed, step1_friction=0.15)
        state = lk.make_specimen(recipe, lk.Scene(law="spring_dashpot"), progress=False)
        for test, path in PATHS.items():
            files.append(folder / f"{test}-s{seed}.run.nc")
            lk.run(state, path, file=files[-1], snapshots=2, progress=False)
    STUDY.gather(files, folder / STUDY.data, "a command")
    assert all(file.exists() for file in STUDY.write(folder, "a command", lambda done, text: None))
    return folder


def test_errors_are_those_that_were_put_in():
    swapped = errors_of(np.array([1.02 * LOVE, 0.98 * LOVE]), np.array([LOVE, LOVE]))
    assert swapped["p"] == pytest.approx(0.0, abs=1e-12) and swapped["norm"] == pytest.approx(0.02)
    assert swapped["xz"] == pytest.approx(0.02 * 0.2e6 / 1e6) and swapped["angle"] == pytest.approx(0.0, abs=1e-9)
    deviator = LOVE - 1e6 * np.eye(3)
    only_q = errors_of((1e6 * np.eye(3) + 0.97 * deviator)[None], LOVE[None])
    assert only_q["p"] == pytest.approx(0.0, abs=1e-12) and only_q["q"] == pytest.approx(-0.03)


def test_the_direction_is_that_of_the_major_principal_stress():
    turn = np.radians(20.0)
    R = np.array([[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]])
    assert direction(R @ np.diag([1.0, 1.2, 2.0]) @ R.T) == pytest.approx(20.0)


@pytest.mark.parametrize("b", [0.0, 0.3, 1.0])
def test_principal_stresses_have_the_b_and_the_strength_asked_for(b):
    s = principal_stresses(b, 0.8)
    assert s.mean() == pytest.approx(1.0) and (s[1] - s[2]) / (s[0] - s[2]) == pytest.approx(b)
    assert equivalent_stress(np.diag(s)) == pytest.approx(0.8)


def test_matsuoka_nakai_has_one_friction_angle_in_compression_and_extension():
    M = matsuoka_nakai(np.array([0.0, 0.5, 1.0]), 0.9)
    assert M[0] == pytest.approx(0.9) and M[2] / M[0] == pytest.approx(3.0 / 3.9)
    assert M[2] < M[1] < M[0]


def test_a_specimen_counts_once_and_all_tests_are_corrected():
    rng = np.random.default_rng(1)
    rows = [
        {"test": test, "specimen": f"s{k}", "p": 0.01 + shift + 1e-4 * rng.standard_normal(), "q": -0.02}
        for test, shift in ((REFERENCE, 0.0), ("extension", 0.01), ("shear", 0.0))
        for k in range(5)
    ]
    frame = comparison(pandas.DataFrame(rows)).set_index(["quantity", "test"])
    assert frame.loc[("p", "extension"), "verdict"] == "less accurate"
    assert frame.loc[("p", "shear"), "verdict"] == "not resolved"
    assert frame.loc[("p", "extension"), "specimens"] == 5
    assert frame.loc[("p", "extension"), "corrected"] >= frame.loc[("p", "extension"), "p_value"]


def test_the_data_set_holds_what_the_runs_hold(folder):
    with xarray.open_dataset(folder / STUDY.data) as data, lk.open_run(folder / "shear-s2.run.nc") as run:
        kept = data.sel(run="shear-s2").load()
        assert set(data["test"].values) == set(PATHS) and data.sizes["run"] == 6
        love = run["stress"].values
    assert kept["stress"].values[[0, -1]] == pytest.approx(love[[0, -1]], rel=1e-6)
    assert kept["accumulated_strain"].values[-1] == pytest.approx(0.03, rel=1e-2)
    error = kept["error_budget"].sum("part").values
    c0 = kept["stress_family"].sel(form="c0").values
    assert c0 - kept["snapshot_stress"].values == pytest.approx(error, abs=1e-4 * mean_stress(love[0]))


def test_the_page_gives_each_test_and_the_ratio_of_the_strengths(folder):
    page = (folder / "README.md").read_text()
    assert "simple shear" in page and "M_e/M_c" in page and "nan" not in page
    for figure in ("strength.png", "c0_errors.png", "c0_components.png"):
        assert f"({figure})" in page and (folder / figure).stat().st_size > 10_000
