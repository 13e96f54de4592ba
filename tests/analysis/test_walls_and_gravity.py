"""Walls, planes and deposits: the balance of a box closes, planted errors are found, a slab keeps its contacts."""

import numpy as np
import pandas
import pytest

import labkit as lk
from analysis.walls_and_gravity.deposits import fabric_row, height_of, slab_of
from analysis.walls_and_gravity.stress import box_rows
from analysis.walls_and_gravity.study import SCENE, deposit_table, love_table, run_scene

pytestmark = pytest.mark.long


def chain():
    """Two grains in a row along z between two walls, pressed with 2 N."""
    radius, force = 1e-4, 2.0
    overlap = 1e-6
    faces = np.array([[0.0, 2e-4], [0.0, 2e-4], [0.0, 4.0 * radius - 3.0 * overlap]])
    z = np.array([radius - overlap, 3.0 * radius - 2.0 * overlap])
    side, up = np.eye(3)[[0, 2]]
    return {
        "strain": np.array(0.0),
        "faces": faces,
        "wall_force": np.array([[-force * side, force * side], np.zeros((2, 3)), [-force * up, force * up]]),
        "radius": np.full(2, radius),
        "position": np.stack([np.full(2, 1e-4), np.full(2, 1e-4), z], axis=1),
        "velocity": np.zeros((2, 3)),
        "force": np.zeros((2, 3)),
        "pair": np.array([[0, 1], [2 + 4, 0], [2 + 5, 1]]),
        "normal": np.array([up, up, -up]),
        "overlap": np.full(3, overlap),
        "normal_force": force * np.array([up, up, -up]),
        "tangential_force": np.zeros((3, 3)),
    }


def test_the_stress_of_a_chain_of_grains_is_that_of_its_walls():
    row = next(row for row in box_rows(chain(), 2650.0) if row["component"] == "zz")
    assert row["force"] == pytest.approx(2.0 / 2e-4**2) and row["love"] == pytest.approx(row["force"], rel=1e-12)
    assert row["friction"] == row["unbalanced"] == row["kinetic"] == 0.0


def test_planted_errors_are_found_and_none_is_invented():
    rng = np.random.default_rng(1)
    rows = []
    for scene, error in (("smooth", 0.0), ("rough", -0.3)):
        for specimen in range(6):
            for component in ("xx", "zz"):
                for strain in (0.0, 0.01, 0.02):
                    love = 1.0 + error + rng.normal(0.0, 2e-3)
                    row = {"scene": scene, "specimen": specimen, "component": component, "strain": strain, "force": 1.0}
                    rows.append(row | {"love": love, "kinetic": 0.0, "unbalanced": 0.0, "friction": 0.0})
    table = love_table(pandas.DataFrame(rows)).set_index(["scene", "state", "component"])
    assert (
        len(table) == 8 and table.loc["smooth", "equivalent"].all() and (table.loc["rough", "corrected"] < 1e-3).all()
    )
    assert table.loc["rough", "error"].sub(-30.0).abs().max() < 1.0


def test_the_share_of_the_tangential_forces_in_deposits_is_found():
    rng = np.random.default_rng(2)
    rows = []
    for specimen in range(6):
        A = 0.2 + rng.normal(0.0, 0.01)
        last = {"A": A, "F": -0.2 * A, "Ft": -0.8 * A / 7.5, "F_paper": -A, "F_with_Ft": -0.2 * A, "A_inside": A}
        rows += [{"specimen": specimen, "stage": stage, **last} for stage in ("deposit", "closed", "500 kPa")]
    table = deposit_table(pandas.DataFrame(rows)).set_index("quantity")
    assert len(table) == 11 and table.loc["share of F^t", "value"] == pytest.approx(0.8)
    assert table.loc["F - F of section 5.3", "corrected"] < 1e-3 < abs(table.loc["F - F with F^t", "value"]) + 2e-3


def test_a_slab_is_as_high_as_its_grains_need():
    state = lk.make_specimen(lk.Recipe(void_ratio=0.7, grains=200, step1_friction=0.19, seed=3), SCENE, progress=False)
    position = state.position % state.cell[0, 0]
    height = height_of(position, state.radius, state.cell[0, 0], SCENE.mean_diameter)
    assert 0.0 < height - np.ptp(position[:, 2]) < 1.3 * SCENE.mean_diameter


@pytest.mark.yade
def test_a_deposit_is_made_on_yade_and_cut_to_a_periodic_slab(tmp_path):
    given = {"scene": "deposit", "wall_friction": [0.4, 0.1], "counts": [5, 5, 9], "gravity": 1000.0, "speed": 0.3}
    steps = {"least_steps": 2000, "most_steps": 14000, "unbalanced": 0.5}
    run_scene(given | steps, 1, tmp_path / "deposit-1.npz")
    with np.load(tmp_path / "deposit-1.npz") as arrays:
        deposit = dict(arrays)
    assert len(deposit["radius"]) == 25 + 225 and int(deposit["floor"]) == 25
    slab = slab_of(deposit, SCENE, 1)
    row = fabric_row(slab)
    assert 20 < row["grains"] < 225 and row["p"] > 0.0
    overlap = slab.snapshot().contacts.overlap
    assert (overlap > 0.0).all() and len(overlap) == len(slab.tangential_force)
