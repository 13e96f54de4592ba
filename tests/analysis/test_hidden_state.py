"""The study of hidden state: what is kept of a test, equal states with other histories, and constants of the law."""

import numpy as np
import pandas
import pytest

import labkit as lk
from analysis.hidden_state import law, loading, twins
from analysis.hidden_state.nearest import compared, differences, pairs_of, ranking
from analysis.hidden_state.records import Records, kept, records_of, sections_of, strain_of_cells
from analysis.hidden_state.table import CANDIDATES, STATE, rounded, tensor
from labkit.micro import to_six


@pytest.fixture(scope="module")
def specimen():
    recipe = lk.Recipe(preparation="compression", pressure=500e3, grains=150, seed=3)
    with pytest.warns(UserWarning, match="largest grains wide"):
        return lk.make_specimen(recipe, lk.Scene(time_step_factor=0.3), progress=False)


@pytest.fixture(scope="module")
def run(specimen):
    path = loading.axial(0.002, -0.002)
    return lk.run(specimen, path, progress=False, record_strain=2.5e-4, snapshots=10_000)


def test_strain_of_cells_is_logarithmic():
    stretch = np.exp(-0.01 * np.arange(11.0))
    strain = strain_of_cells(stretch[:, None, None] * np.eye(3))
    np.testing.assert_allclose(strain[-1], 0.1 * np.eye(3), rtol=1e-5)


@pytest.mark.parametrize(("turns", "sections"), [((0.01,), 1), ((0.01, -0.01), 2), ((0.01, -0.01, 0.02, 0.0), 4)])
def test_sections_count_reversals(turns, sections):
    axial = np.concatenate([np.linspace(a, b, 11)[:-1] for a, b in zip((0.0, *turns[:-1]), turns, strict=True)])
    strain = np.outer(axial, [-0.5, -0.5, 1.0, 0.0, 0.0, 0.0])
    assert sections_of(strain)[-1] + 1 == sections


def test_kept_records_contain_every_reversal():
    section = np.repeat(np.arange(3), 300)
    assert {0, 299, 300, 599, 600, 899} <= set(kept(section).tolist())


def test_records_agree_with_the_run_and_survive_their_file(run, tmp_path):
    records = records_of(run)
    assert records.columns["section"].max() == 1
    statistics = lk.statistics(run.snapshots[-1])
    np.testing.assert_allclose(records.columns["A"][-1], to_six(statistics.contact_anisotropy), atol=1e-6)
    assert 0.0 < records.columns["new"][-1] < 1.0
    records.save(tmp_path / "x.npz")
    np.testing.assert_array_equal(Records.load(tmp_path / "x.npz").columns["strong"], records.columns["strong"])


def test_a_snapshot_becomes_a_state_with_the_same_stress(run, specimen):
    snapshot = run.snapshots[-1]
    state = twins.state_of_snapshot(snapshot, specimen)
    np.testing.assert_allclose(
        lk.love_stress(state.snapshot()),
        lk.love_stress(snapshot),
        rtol=1e-6,
        atol=1e-6 * lk.love_stress(snapshot).max(),
    )


def test_tensor_inverts_mandel_notation_and_rounding_keeps_three_digits():
    six = np.arange(1.0, 7.0)
    np.testing.assert_allclose(to_six(tensor(six)), six)
    values = np.array([0.123456, -7.654321e5], "f4")
    np.testing.assert_allclose(rounded(values, 10), values, rtol=5e-4)
    assert (rounded(values, 10) != values).any()


def synthetic_rows(memory):
    """States of four packings whose D depends on Z and, times `memory`, on the share of sliding contacts."""
    generator, rows = np.random.default_rng(0), []
    tensors = {"A", "F", "Ft", "strong", "young"}
    for packing in ("dense-s1", "dense-s2", "dense-s3", "dense-s4"):
        for kind in ("cycles", "monotonic"):
            for _ in range(60):
                row = {
                    name: generator.normal(size=6) * 0.1 if name in tensors else 0.0 for name in (*STATE, *CANDIDATES)
                }
                row |= {name: generator.normal() for name in (*STATE, *CANDIDATES) if name not in tensors}
                row["e"], row["Lambda"] = 0.1 * row["e"], 0.1 * row["Lambda"]
                row["sliding"] += 2.0 if kind == "cycles" else 0.0
                row |= {f"d{name}": np.zeros(6) + generator.normal() for name in ("A", "F", "Ft")}
                row |= {"dZ": generator.normal(), "dLambda": generator.normal()}
                D = row["Z"] + memory * row["sliding"] + 0.2 * generator.normal()
                n = np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0]) / np.sqrt(2.0)
                rows.append(row | {"D": D, "n": n, "kind": kind, "density": "dense", "packing": packing})
    return pandas.DataFrame(rows)


@pytest.mark.parametrize("memory", [3.0, 0.0])
def test_hidden_variables_are_told_from_states(memory, monkeypatch):
    monkeypatch.setattr("analysis.hidden_state.nearest.FAR", 2.0)
    monkeypatch.setattr("analysis.hidden_state.nearest.BINS", np.array([0.0, 1.0]))
    rows = synthetic_rows(memory)
    made = differences(rows, pairs_of(rows))
    assert (compared(made).set_index("rate").loc["D", "verdict"] == "remembered") == (memory > 0.0)
    best = ranking(rows, made).iloc[1]
    assert (best["candidate"] == "sliding" and best["memory"] == "yes") == (memory > 0.0)


def test_stiffness_is_fitted_to_the_training_seeds_alone():
    Z = np.tile(np.linspace(4.0, 6.5, 6), 4)
    seed = np.repeat([1, 2, 3, 4], 6)
    slope = np.where(seed < 3, 60.0 * (Z - 3.0), 0.0) + 0.1 * np.sin(40.0 * Z * seed)
    table = pandas.DataFrame({"seed": seed, "Z": Z, "slope": slope, "packing": [f"dense-s{one}" for one in seed]})
    fit = law.stiffness_fit(table)
    assert fit.loc[0, ["k", "Z_0"]].tolist() == pytest.approx([60.0, 3.0], rel=0.02)
    assert law.chosen_stiffness(fit) == pytest.approx((60.0, 3.0), rel=0.02)


def test_twelve_directions_are_deviatoric_units():
    n = twins.directions()
    assert n.shape == (12, 6)
    np.testing.assert_allclose(n[:, :3].sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)
