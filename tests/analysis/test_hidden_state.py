"""The study of hidden state: what is kept of a test, equal states with other histories, and constants of the law."""

import dataclasses

import numpy as np
import pandas
import pytest

import labkit as lk
from analysis.hidden_state import contest, cycles, driving, equal, law, loading, table, twins
from analysis.hidden_state.nearest import compared, differences, pairs_of, ranking
from analysis.hidden_state.records import Records, records_of
from analysis.hidden_state.table import CANDIDATES, RATES, STATE, rounded, tensor
from analysis.peers.laws import PEERS
from analysis.places import results_folder
from labkit.micro import mean_stress, to_six
from labkit.model import MEASURED_REVERSALS as TERMS
from labkit.model import Model, drive, isotropic_state


@pytest.fixture(scope="module")
def specimen():
    recipe = lk.Recipe(preparation="compression", pressure=500e3, grains=150, seed=3)
    with pytest.warns(UserWarning, match="largest grains wide"):
        return lk.make_specimen(recipe, lk.Scene(time_step_factor=0.3), progress=False)


@pytest.fixture(scope="module")
def run(specimen):
    path = loading.axial(0.002, -0.002)
    return lk.run(specimen, path, progress=False, record_strain=2.5e-4, snapshots=10_000)


def test_records_agree_with_the_run_and_survive_their_file(run, tmp_path):
    records = records_of(run)
    columns, strain = records.columns, run.data["axial_strain"].values
    assert columns["section"].max() == 1
    turns = [columns["strain"][k, 2] for k in (columns["strain"][:, 2].argmax(), -1)]  # both are kept
    assert turns == pytest.approx([strain.max(), strain[-1]], rel=1e-4)
    statistics = lk.statistics(run.snapshots[-1])
    np.testing.assert_allclose(records.columns["A"][-1], to_six(statistics.contact_anisotropy), atol=1e-6)
    assert 0.0 < records.columns["new"][-1] < 1.0
    records.save(tmp_path / "x.npz")
    np.testing.assert_array_equal(Records.load(tmp_path / "x.npz").columns["strong"], records.columns["strong"])


def test_a_snapshot_becomes_a_state_with_the_same_stress(run, specimen):
    snapshot = run.snapshots[-1]
    state = driving.state_of_snapshot(snapshot, specimen)
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
    n = driving.directions()
    assert n.shape == (12, 6)
    np.testing.assert_allclose(n[:, :3].sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)


def test_a_member_is_driven_towards_a_state(specimen, monkeypatch):
    monkeypatch.setattr(driving, "EVALUATIONS", 24)
    monkeypatch.setattr(driving, "ENOUGH", 1e-3)

    class Fixed(driving.Scale):
        def __init__(self):
            self.size = {"e": 1e-3, "Z": 1.0, "Lambda": 1e-4, "A": 1.0, "F": 0.5, "Ft": 0.05}

    shear = 1e-3 * np.array([[-0.5, -0.5, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.5, 0.0], [0.0] * 6])
    target = Fixed().vector(driving.values_of(driving.strained(specimen, shear)))
    begin = 0.3 * shear + 1e-5  # from 0.8, the search may end where it began, as grains answer in steps
    _, before, distance = driving.driven(specimen, begin, target, Fixed())
    assert distance < 0.5 * before


def synthetic_pairs(memory):
    """Twins whose D differs by noise and, between other histories, by `memory` times the share of sliding contacts."""
    generator, pairs, tensors = np.random.default_rng(0), [], {"A", "F", "Ft", "strong", "young"}
    for sort in (twins.OTHER, twins.SAME):
        for k in range(16):
            state = {name: generator.normal(size=(2, 6 if name in tensors else 1)) for name in (*STATE, *CANDIDATES)}
            D = 0.1 * generator.normal(size=(2, 12))
            if sort == twins.OTHER:
                D += memory * state["sliding"]
            off = {name: np.abs(D[0] - D[1]).tolist() for name in RATES}
            pairs.append({"name": f"{sort} {k}", "density": "dense", "sort": sort, "before": 0.2, "distance": 0.05})
            pairs[-1] |= {"off": off, "D": D.tolist(), "on": generator.normal(size=(2, 2, 4)).tolist()}
            pairs[-1]["seeds"] = [1 + k % 8, 1 + (k + 1 + k // 8) % 8]
            pairs[-1]["state"] = {name: values.tolist() for name, values in state.items()}
    return pairs


@pytest.mark.parametrize("memory", [0.5, 0.0])
def test_twins_tell_whether_something_is_remembered(memory):
    pairs = synthetic_pairs(memory)
    rates = equal.compared_rates(pairs).set_index(["rate", "density"])
    assert (rates.loc[("D", "all"), "verdict"] == "remembered") == (memory > 0.0)
    best = equal.ranked(pairs).iloc[1]
    assert (best["candidate"] == "sliding" and best["memory"] == "yes") == (memory > 0.0)


@pytest.fixture(scope="module")
def of_model():
    """The model, and a test that is its own path at constant mean stress with a reversal."""
    model = Model()
    result = drive(model, loading.axial(0.004, 0.001), isotropic_state(model, 0.67, loading.PRESSURE), 2e-4)
    columns = {"strain": to_six(result.strain), "stress": to_six(result.stress), "e": result.e, "Z": result.Z}
    columns |= {"Lambda": result.Lam, "A": to_six(result.A), "F": to_six(result.F), "Ft": to_six(result.Ft)}
    size = np.linalg.norm(np.diff(columns["strain"], axis=0), axis=1)
    columns |= {"along": np.concatenate([[0.0], np.cumsum(size)]), "section": np.zeros(len(result), int)}
    return model, table.Test("small", "dense", 1, columns, 0.0, "")


def test_a_law_that_follows_its_own_path_has_no_error(of_model):
    model, test = of_model
    row = contest.errors_of(model, contest.vector_of("own", model, test, None), test)
    assert row["reached"] == 1.0
    assert max(row["stress"], row["volume"], row["A"], row["F"]) < 1.0 and row["D"] < 0.01


def test_peers_remember_with_the_constants_of_a_table(of_model):
    """Laws with a memory have the fitted constants and are their peers otherwise; the two forms are in the model."""
    model, _ = of_model
    constants = law.Constants(np.array([0.0, 0.5]), np.array([0.0, 0.9]), np.array([0.0, 0.9]), (46.5, 2.57))
    peers = {name: kind() for name, kind in ((kind.name, kind) for kind in PEERS) if name in (*contest.MEMORY, "acst")}
    rows = [(name, one, 0.0, 2.0 * peers[name].values[one]) for name, own in contest.MEMORY.items() for one in own[:1]]
    memory = pandas.DataFrame(rows, columns=["law", "constant", "stored", "fitted"])
    laws = contest.contestants({"calibrated": model}, peers, memory, constants)
    for name, own in contest.MEMORY.items():
        changed = {one for one, value in laws[f"{name}, reversals"].values.items() if value != peers[name].values[one]}
        assert changed == {own[0]}
    assert laws[contest.FORMS].reversals.F_0 == 0.9 and laws["calibrated"].reversals.K_F == 0.0


def test_the_constants_in_the_package_are_those_that_were_measured():
    table = pandas.read_csv(f"{results_folder('hidden_state')}/constants.csv", index_col="constant")
    e = np.array([0.6, 0.7, 0.8])
    assert table.loc["K", ["e = 0.6", "e = 0.7"]].tolist() == pytest.approx([TERMS.K_F, TERMS.Z_F], rel=1e-4)
    np.testing.assert_allclose(TERMS.F_0 + TERMS.F_e * e, table.loc["F_c"].to_numpy(float), rtol=1e-3)
    np.testing.assert_allclose(TERMS.A_0 + TERMS.A_e * e, table.loc["A_c"].to_numpy(float), rtol=1e-3)


def test_the_two_forms_hold_the_mean_stress(of_model):
    model, test = of_model
    constants = law.Constants(np.array([0.0, 0.5]), np.array([0.0, 0.9]), np.array([0.0, 0.9]), (46.5, 2.57))
    forms = dataclasses.replace(model, reversals=constants.reversals())
    states = contest.followed(forms, contest.vector_of("forms", model, test, constants), test)
    p = [float(mean_stress(model.stress(state))) for state in states]
    np.testing.assert_allclose(p, p[0], rtol=2e-3)
    assert np.ptp(states[:, 0]) > 1e-5


def test_cycles_are_counted_for_grains_and_laws(of_model):
    model, _ = of_model
    start = isotropic_state(model, 0.74, loading.PRESSURE)
    row = {"density": "loose", "seed": 1, "ratio": 0.3, "N": 2.0, "e": [start.e], "Z": [start.Z], "Lambda": [start.Lam]}
    row |= {name: [0.0] * 6 for name in ("A", "F", "Ft")} | {"stress": [500e3] * 3 + [0.0] * 3}
    counts = cycles.counted([row], {"model": model}, None)
    assert counts["N"].between(0.2, cycles.MOST).all() and counts["law"].tolist() == ["grains", "model"]
    errors = cycles.errors_of_cycles(counts)
    assert errors["factor"][0] == pytest.approx(counts["N"][1] / 2.0)
