"""Figures and commands that follow the path of a run: stress path, deviatoric plane, simple shear, cycles."""

import shutil

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.figures import plots
from labkit.figures.frame import strain_axis
from labkit.figures.liquefaction_figure import cyclic_resistance
from labkit.figures.path_figures import cycles, pi_plane, shear, stress_path
from labkit.model import Model, drive, isotropic_state, model_path
from labkit.model.run_file import write_result
from labkit.results.critical import critical_states, mean_strengths, require_critical
from labkit.results.figures import FIGURES
from labkit.results.verify import findings_table

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sheared(shear_file):
    return lk.open_run(shear_file)


@pytest.fixture(scope="module")
def liquefied(liquefied_file):
    return lk.open_run(liquefied_file)


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    """Simple shear of the constitutive model, sigma_z held."""
    file = tmp_path_factory.mktemp("model") / "model.run.nc"
    path = model_path("simple_shear", 1e5, strain=0.2)
    write_result(file, drive(Model(), path, isotropic_state(Model(), 0.7, 1e5)))
    return file


def curve(axes, number=0):
    return np.asarray(axes.get_lines()[number].get_xdata()), np.asarray(axes.get_lines()[number].get_ydata())


def test_simple_shear_is_drawn_against_gamma(sheared):
    figure, drawn = shear(sheared)
    x, y = curve(figure.axes[0])
    np.testing.assert_allclose(x, 100 * sheared.lab.strain().values)
    np.testing.assert_allclose(y, 0.5e-3 * (sheared["stress"].values[:, 0, 2] + sheared["stress"].values[:, 2, 0]))
    assert figure.axes[0].get_xlabel() == r"shear strain $\gamma_{xz}$ (%)"
    assert drawn["sigma_zz_Pa"].iloc[1:].to_numpy() == pytest.approx(1e5, rel=0.02)
    assert lk.Run(sheared).plot().axes[0].get_ylabel() == figure.axes[0].get_ylabel()  # the default of the path


def test_every_figure_of_a_record_uses_the_strain_of_the_path(sheared, liquefied):
    figure, _ = plots.records(sheared, variable="coordination_number")
    assert figure.axes[0].get_xlabel().startswith("shear strain")
    assert strain_axis(liquefied)[0] == "number of cycles N"
    assert plots.test(sheared)[0].axes[0].get_xlabel().startswith("shear strain")


def test_a_test_is_drawn_with_its_volume_and_in_kilopascals(sheared):
    figure, drawn = plots.test(sheared)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels[0] == "deviatoric stress,\ninvariant q (kPa)" and labels[3:] == [
        "stress ratio q/p",
        "volumetric strain, logarithmic,\ncompression positive (%)",
        "void ratio e",
    ]
    np.testing.assert_allclose(curve(figure.axes[0])[1], 1e-3 * sheared.lab.q().values)
    np.testing.assert_allclose(curve(figure.axes[4])[1], 100 * sheared.lab.volumetric_strain().values)
    x, y = curve(figure.axes[5])
    assert figure.axes[5].get_xscale() == "log" and "mean stress p (kPa)" == figure.axes[5].get_xlabel()
    np.testing.assert_allclose(x, 1e-3 * sheared.lab.mean_stress().values)
    np.testing.assert_allclose(y, sheared["void_ratio"].values)
    assert drawn["void_ratio"].tolist() == sheared["void_ratio"].values.tolist()


def test_rounding_of_a_constant_volume_is_not_magnified(liquefied):
    figure, _ = stress_path(liquefied)
    low, high = figure.axes[1].get_ylim()
    assert high - low >= 0.01 > 100 * np.ptp(liquefied["void_ratio"].values)


def test_the_strength_of_the_paper_is_not_drawn_over_another_soil(sheared):
    assert "Table 2" in str(figure_labels(sheared))
    other = sheared.assign_attrs(scene=lk.Scene(friction=0.5).to_json())
    assert not any(text.startswith("q =") for text in figure_labels(other))
    kept = {"other": other.assign_attrs(path="cv")}
    assert all("q = 0.92 p" not in text.get_text() for text in plots.e_p_paths(kept).legends[0].get_texts())


def figure_labels(run):
    return [text.get_text() for text in stress_path(run)[0].legends[0].get_texts()]


def test_cycles_show_pore_pressure_and_liquefaction(liquefied):
    figure, drawn = cycles(liquefied)
    x, y = curve(figure.axes[0])
    np.testing.assert_allclose(x, liquefied.lab.cycles())
    np.testing.assert_allclose(y, liquefied.lab.pore_pressure_ratio())
    assert figure.axes[0].get_ylabel() == "pore pressure ratio $r_u$" and drawn["r_u"].max() > 0.95
    force = curve(figure.axes[6])[1]
    assert np.isnan(force).any() and np.nanmax(np.abs(force)) < 5.0  # not drawn where contacts are lost


def test_the_deviatoric_plane_has_its_sections_at_the_strength(sheared):
    figure, _ = pi_plane(sheared, strength=1.2)
    for number in range(3):  # Mohr-Coulomb, Matsuoka-Nakai, model
        x, y = curve(figure.axes[0], number)
        assert np.interp(0.0, x[350:372], y[350:372]) == pytest.approx(1.2, rel=1e-3)
        assert np.hypot(x, y).max() == pytest.approx(1.2, rel=1e-3)
    along, ratio = curve(figure.axes[1])
    assert along.max() < 0.5 and ratio[-1] > 0.2
    x, y = curve(figure.axes[0], 9)  # after the sections and axes
    q, p, theta = sheared.lab.q().values, sheared.lab.mean_stress().values, np.radians(sheared.lab.lode_angle().values)
    np.testing.assert_allclose(x, q / p * np.sin(theta), atol=1e-9)
    np.testing.assert_allclose(y, q / p * np.cos(theta), atol=1e-9)


def test_the_stress_path_shows_grains_and_model_together(sheared, model_file):
    model = lk.open_run(model_file)
    figure, drawn = stress_path({"grains": sheared, "model": model})
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    by_volume = "stress-force-fabric equation by volume"
    assert {"grains", "model", "stress from contacts (Love)", by_volume, "constitutive model (C0)"} <= set(labels)
    assert set(drawn["run"]) == {"grains", "model"}
    assert any("Table 2" in label for label in labels)
    assert float(model.lab.strain()[-1]) == pytest.approx(0.2)


def test_the_critical_state_of_simple_shear_uses_gamma_and_the_invariant_q(sheared, liquefied):
    kept, left_out = require_critical({"shear": sheared, "cycles": liquefied})
    assert tuple(kept) == ("shear",) and list(left_out) == ["cycles"]
    states = critical_states(kept)
    last = sheared.lab.strain().values >= 0.75 * float(sheared.lab.strain()[-1])
    assert states["M"][0] == pytest.approx((sheared.lab.q() / sheared.lab.mean_stress()).values[last].mean())
    assert states["strain"][0] > 0.19 and states["A_zz"][0] > 0.1
    (mean,) = mean_strengths(kept, states)
    assert mean.endswith(f" {states['M'][0]:.3f}")
    _, short = require_critical({"shear": sheared, "early": sheared.isel(time=slice(10))})
    assert "shear strain gamma_xz, before 0.15" in short["early"]


def test_the_table_of_findings_uses_the_strain_of_the_path(sheared):
    assert (
        findings_table(sheared, 3).splitlines()[0].split()
        == "strain p q Z Lambda A_s F_s Ft_s C0 error by volume".split()
    )
    assert float(findings_table(sheared, 3).splitlines()[-1].split()[0]) == pytest.approx(20.0, rel=0.03)


def test_the_command_draws_several_runs_and_refuses_what_does_not_fit(shear_file, model_file, tmp_path, capsys):
    files, output = [str(shear_file), str(model_file)], str(tmp_path / "p.png")
    assert main(["figure", "pi_plane", *files, "--strength", "0.9", "-o", output]) == 0
    assert (tmp_path / "p.png").read_bytes()[:4] == b"\x89PNG"
    for words, said in (
        (["groups", *files], "groups draws one run"),
        (["shear", files[0], "--strength", "1"], "only to stress_path, pi_plane"),
    ):
        capsys.readouterr()
        assert main(["figure", *words, "-o", str(tmp_path / "x.png")]) == 2
        error = capsys.readouterr().err
        assert said in error and len(error.strip().splitlines()) == 1


def test_each_run_of_a_users_figure_needs_its_snapshots(shear_file, model_file, tmp_path, labkit_command):
    (tmp_path / "mine.py").write_text(
        "import labkit as lk, pandas as pd\nfrom matplotlib.figure import Figure\n"
        "@lk.register_figure('mine', several=True)\n"
        'def mine(runs):\n    """Nothing."""\n    return Figure(), pd.DataFrame({\'runs\': [len(runs)]})\n'
    )
    words = ["figure", "mine", shear_file, "--use", "mine.py", "-o", "m.png"]
    shutil.copy(shear_file, tmp_path / "second.run.nc")
    done = labkit_command(*words[:3], "second.run.nc", *words[3:], cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.endswith("2\n"), done.stderr
    done = labkit_command(*words[:3], model_file, *words[3:], cwd=tmp_path)
    assert done.returncode == 2 and "model.run.nc holds no contacts" in done.stderr


def test_a_figure_says_what_it_lacks(sheared):
    with pytest.raises(lk.InputError, match="step 2 does not apply to the figure envelope, only to figures of runs"):
        FIGURES["envelope"](sheared, step=2)
    with pytest.raises(lk.InputError, match="the figure test has no run: give it first"):
        FIGURES["test"](run=sheared)


def test_cyclic_resistance_has_a_point_for_each_test(liquefied):
    """N and CSR recomputed from the records; a test that met no criterion has an arrow at its last cycle."""
    short = liquefied.isel(time=slice(0, 12))
    figure, table = cyclic_resistance({"whole": liquefied, "short": short})
    stress, N = liquefied["stress"].values, liquefied.lab.cycles().values
    p = np.trace(stress, axis1=1, axis2=2) / 3.0
    first = np.flatnonzero(1.0 - p / p[0] > 0.95)
    assert table["CSR"].to_numpy() == pytest.approx(liquefied.lab.path.amplitude / (2.0 * p[0]))
    assert table["cycles_to_ratio"][0] == N[first[0]] and np.isnan(table["cycles_to_ratio"][1])
    points = {(line.get_marker(), float(line.get_xdata()[0])) for line in figure.axes[0].get_lines()}
    assert {("o", N[first[0]]), (">", N[11])} <= points


def test_a_test_without_a_csr_or_without_its_first_cycles_has_no_resistance(sheared, liquefied):
    with pytest.raises(lk.InputError, match="simple_shear has no CSR: give undrained_cycles, or shear_cycles"):
        cyclic_resistance(sheared)
    before = {"undrained_before": 2.0 * liquefied["stress"].values[0].ravel()}
    with pytest.raises(lk.InputError, match="its earlier cycles are in another run"):
        cyclic_resistance(liquefied.assign_attrs(before))
