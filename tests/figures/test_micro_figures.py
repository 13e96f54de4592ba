"""`labkit figure`, and the statistics that the accessor computes over a run."""

import numpy as np
import pandas
import pytest

import labkit
from labkit.cli import main
from labkit.errors import InputError
from labkit.figures.direction_figure import directions
from labkit.micro.contact_sides import vectors_of_contacts
from labkit.micro.fabric import directional_mean, normal_density, tangential_mean
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.results.figures import FIGURES, RunFigure
from labkit.results.run import Run
from labkit.sff.family import FORMS

pytestmark = pytest.mark.slow

OF_RUNS = [name for name in FIGURES if FIGURES[name].needs != "probes"]


@pytest.fixture(scope="module")
def run(run_file):
    return labkit.open_run(run_file)


def test_a_figure_takes_only_its_options(run):
    with pytest.raises(InputError, match=r"snapshot 2 does not apply to the figure contacts, only to .*planes"):
        Run(run).plot("contacts", snapshot=2)
    seen = {}
    own = RunFigure("own", lambda run, **options: seen.update(options))
    own(run, groups=3, title="sand")
    assert seen == {"groups": 3, "title": "sand"}


def test_the_tangential_force_towards_z_is_the_component_along_the_meridian(run):
    """Against spherical coordinates: the mean over the azimuths of the second-order fit, in every bin."""
    table, vectors = directions(run)[1], vectors_of_contacts(run.lab.snapshot(-1))
    density = normal_density(vectors.normal)
    mean = directional_mean(vectors.normal, vectors.normal_component, density).mean
    fit = tangential_mean(vectors.normal, -vectors.tangential / mean, density)
    rows = table[table["function"].str.contains("e_theta")]
    azimuth = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    for angle, found in zip(np.radians(rows["angle_deg"]), rows["order_2"], strict=True):
        across = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(24)], axis=1)
        z = np.array([0.0, 0.0, 1.0])
        n, towards = np.sin(angle) * across + np.cos(angle) * z, np.sin(angle) * z - np.cos(angle) * across
        assert found == pytest.approx(np.mean(np.sum(fit.at(n) * towards, axis=1)), abs=1e-12)


@pytest.mark.parametrize(
    ("variable", "columns"),
    [
        ("overlap_ratio", ["overlap_ratio"]),
        ("stress", [f"stress_{ij}" for ij in ("xx", "xy", "xz", "yy", "yz", "zz")]),
        ("drift_velocity", [f"drift_velocity_{i}" for i in "xyz"]),
    ],
)
def test_any_recorded_variable_can_be_drawn(variable, columns, run, run_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["figure", "records", str(run_file), "--variable", variable, "-o", "f.png", "--csv", "f.csv"]
    assert main(arguments) == 0
    table = pandas.read_csv("f.csv")
    assert list(table.columns) == ["axial_strain", *columns] and len(table) == run.sizes["time"]
    last = run[variable].values[-1]
    last = last[np.triu_indices(3)] if last.ndim == 2 else np.ravel(last)
    np.testing.assert_allclose(table[columns].values[-1], last, rtol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["roses"], "roses"),
        (["groups", "--groups", "0"], "groups"),
        (["directions", "--snapshot", "99"], "snapshot 99"),
        (["groups", "-o", "f.txt"], "f.txt"),
        (["records"], "--variable is missing: give one of axial_strain, strain"),
        (["records", "--variable", "colour"], "--variable colour is not recorded: give one of axial_strain, strain"),
        (
            ["groups", "--variable", "stress"],
            "--variable stress does not apply to the figure groups, only to records: give groups",
        ),
        (
            ["test", "--groups", "3"],
            "--groups 3 does not apply to the figure test, only to groups, densities: give equation",
        ),
    ],
)
def test_bad_input(arguments, message, run_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["figure", arguments[0], str(run_file), *arguments[1:]]) == 2
    error = capsys.readouterr().err
    assert message in error and len(error.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_groups_and_family_and_budget_are_consistent_over_a_run(run):
    love, family, budget = run.lab.love_stress(), run.lab.sff_family(), run.lab.error_budget()
    groups = run.lab.size_groups(7)
    total = (groups["by_volume"] * groups["per_volume"].fillna(0)).sum("group")
    np.testing.assert_allclose(total, love, rtol=1e-11, atol=1e-9 * float(abs(love).max()))
    assert list(family["form"].values) == list(FORMS)
    np.testing.assert_allclose(family.sel(form="c0"), run.lab.sff_stress(), rtol=1e-11, atol=1e-6)
    np.testing.assert_allclose(budget.sum("part"), family.sel(form="c0") - love, atol=1e-9 * float(abs(love).max()))


def test_the_fourth_order_form_is_closer_to_love_than_c0(run):
    """With 300 grains, equal stress of all sizes is the largest source of error in C0."""
    love, family = run.lab.love_stress().values, run.lab.sff_family(("c0", "fourth"))
    errors = [np.linalg.norm(family.sel(form=form).values - love, axis=(1, 2)).mean() for form in ("fourth", "c0")]
    assert errors[0] < 0.5 * errors[1]


def test_shares_over_strain_add_up_to_c0(run):
    shares = run.lab.strength_shares()
    sff = run["stress_sff"].values
    np.testing.assert_allclose(shares.sum("term"), deviatoric_stress(sff) / mean_stress(sff), atol=1e-10)


def test_lives_and_changes_agree_with_the_contacts_of_the_snapshots(run):
    changes, lives = run.lab.contact_changes(), run.lab.contact_lives()
    assert changes["contacts"].values.tolist() == run["row_size"].values.tolist()
    gone = changes["contacts"].values[:-1] - changes["lost"].values[1:]
    assert gone.tolist() == changes["kept"].values[1:].tolist()
    assert int(lives["alive"].sum()) == int(run["row_size"][-1])
    assert (changes["kept"] + changes["gained"])[1:].values.tolist() == run["row_size"].values[1:].tolist()
    assert float(changes["mean_age"][-1]) <= float(run["axial_strain"][-1]) + 1e-12


def test_strong_contacts_are_the_minority_and_carry_most_of_q(run):
    strong = run.lab.strong_networks().isel(snapshot=-1)
    assert (strong["fraction"] < 0.5).all() and (strong["share_of_q"] > 0.7).all()


def test_any_function_of_contacts_can_be_followed(run):
    def largest(snapshot):
        force = snapshot.contacts.normal_force
        return {"largest_force": force.max(), "love": love_stress(snapshot), "forces": (("part",), force[:5])}

    found = run.lab.over_snapshots(largest, {"largest_force": {"units": "N"}})
    assert found["largest_force"].dims == ("snapshot",) and found["largest_force"].units == "N"
    assert found["love"].dims == ("snapshot", "i", "j") and found["forces"].dims == ("snapshot", "part")
    np.testing.assert_array_equal(found["love"], run.lab.love_stress())
    with pytest.raises(InputError, match="shape"):
        run.lab.over_snapshots(lambda snapshot: {"radius": snapshot.radius})
    assert float(found["largest_force"][-1]) == float(run.lab.contacts(-1)["normal_force"].max())


@pytest.mark.parametrize("figure", ["family", "densities", "directions", "planes"])
def test_a_snapshot_without_contacts_is_not_drawn(figure, apart):
    with pytest.raises(InputError, match="has no contacts"):
        Run(apart).plot(figure)
    assert Run(apart).plot(figure, snapshot=0) is not None


@pytest.fixture(scope="module")
def apart(run):
    """A run whose last snapshot has no contacts."""
    sizes = run["row_size"].copy()
    last = int(sizes[-1])
    sizes[-1] = 0
    return run.isel(contact=slice(0, -last)).assign(row_size=sizes)


def test_tables_of_simple_shear_have_the_shear_strain(soft_specimen):
    path = labkit.paths.SimpleShearConstantVolume(strain=0.01, rate=100.0)
    run = labkit.run(soft_specimen, path, progress=False, record_strain=5e-3, snapshots=2).data
    gamma = run.lab.strain().values
    assert gamma[-1] == pytest.approx(0.01, rel=1e-3) and abs(run["axial_strain"].values).max() < 1e-4
    assert labkit.Run(run).plot("shares") is not None
    for figure in ("shares", "budget", "groups"):
        table = FIGURES[figure](run)[1]
        assert sorted(set(table["strain"])) == pytest.approx(sorted(gamma), abs=1e-12)
    budget = FIGURES["budget"](run)[1]
    assert set(budget[budget["norm_standard_error"].notna()]["strain"]) == {gamma[-1]}
