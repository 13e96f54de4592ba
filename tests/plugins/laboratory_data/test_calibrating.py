import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.laboratory_data import posterior
from labkit.plugins.laboratory_data.posterior import posterior_of
from labkit.plugins.laboratory_data.sampling import ALONG, Sample, append_sample, read_samples, take_sample
from tests.plugins.laboratory_data.columns import of_columns

pytest.importorskip("sklearn")
pytest.importorskip("emcee")

FREE = {"friction": (0.1, 1.0), "rolling_friction": (0.0, 0.5)}
SCATTER = {"stress_ratio": 0.03, "volumetric_strain": 0.003}
HIDDEN = {"friction": 0.62, "rolling_friction": 0.13}
KINDS = {"strain_kind": "logarithmic", "stress_kind": "effective", "source": "-", "licence": "-"}


def curves(friction, rolling_friction, along):
    """q/p and volumetric strain of an imagined material, smooth in both parameters."""
    ratio = (0.6 + 0.8 * friction + 0.7 * rolling_friction) * (1.0 - np.exp(-along / 0.2))
    return ratio, 0.01 * along - 0.06 * friction * along**2 + 0.1 * rolling_friction * along


def measured_test(folder, **others):
    rows = ["e ev s1 s3"]
    for along in np.linspace(0.0, 1.0, 41):
        ratio, volume = curves(**{**HIDDEN, **others}, along=along)
        stress = 100.0 * (1.0 + 2.0 * ratio / 3.0) / (1.0 - ratio / 3.0)
        rows.append(f"{0.1 * along} {volume} {stress} 100")
    file = folder / "measured.txt"
    file.write_text("\n".join(rows))
    columns = of_columns(e1="e:1", ev="ev:1", s1="s1:kPa", s3="s3:kPa")
    path = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.1)
    return lk.read_measured(file, path, columns, void_ratio=0.75, **KINDS)


@pytest.fixture
def short_chains(monkeypatch):
    """The imagined curves are so simple that a quarter of the usual draws is enough."""
    monkeypatch.setattr(posterior, "LENGTH", 200)
    monkeypatch.setattr(posterior, "BURNT", 80)


@pytest.fixture()
def tests(tmp_path):
    return lk.GrainTests({"one": measured_test(tmp_path)}, FREE, SCATTER)


def imagined_samples(number, fails=lambda parameters: False):
    random = np.random.default_rng(3)
    samples = []
    for k in range(number):
        parameters = {name: float(random.uniform(*ends)) for name, ends in FREE.items()}
        points = np.concatenate(curves(**parameters, along=np.array(ALONG)))
        points += np.repeat([0.01, 0.001], len(ALONG)) * random.normal(size=len(points))
        failed = fails(parameters)
        values = None if failed else points.tolist()
        samples.append(Sample(parameters, 300, k, values, "it fell apart" if failed else "", 1.0))
    return samples


@pytest.mark.slow
def test_the_posterior_contains_the_hidden_parameters(tests, short_chains):
    found = posterior_of(tests, imagined_samples(24))
    table = found.table()
    for name, hidden in HIDDEN.items():
        assert table["5 %"][name] < hidden < table["95 %"][name]
        low, high = FREE[name]
        assert table["95 %"][name] - table["5 %"][name] < 0.6 * (high - low)  # narrower than the prior
    assert table["50 %"]["misfit"] < 3.0
    again = posterior_of(tests, imagined_samples(24)).draws
    np.testing.assert_array_equal(again.to_numpy(), found.draws.to_numpy())


@pytest.mark.slow
def test_the_posterior_avoids_where_samples_fail(tests):
    wide = lk.GrainTests(tests.measured, FREE, {name: 30.0 * one for name, one in SCATTER.items()})
    failing = imagined_samples(32, lambda parameters: parameters["friction"] > 0.6)
    share = (posterior_of(wide, failing).draws["friction"] > 0.7).mean()
    assert share < 0.5 * (posterior_of(wide, imagined_samples(32)).draws["friction"] > 0.7).mean()


def test_too_few_samples_are_refused_with_the_reason(tests):
    with pytest.raises(lk.InputError, match="it fell apart"):
        posterior_of(tests, imagined_samples(12, lambda parameters: True))


def test_unknown_parameters_and_samples_of_other_tests_are_refused(tests, tmp_path):
    with pytest.raises(lk.InputError, match="fricton"):
        lk.GrainTests(tests.measured, {"fricton": (0.1, 1.0)}, SCATTER)
    with pytest.raises(lk.InputError, match="lowest"):
        lk.GrainTests(tests.measured, {"friction": (1.0, 0.1)}, SCATTER)
    append_sample(imagined_samples(1)[0], tmp_path / "s.jsonl")
    assert read_samples(tests, tmp_path / "s.jsonl") == imagined_samples(1)
    other = lk.GrainTests(tests.measured, {"friction": (0.1, 1.0)}, SCATTER)
    with pytest.raises(lk.InputError, match="other tests or parameters"):
        read_samples(other, tmp_path / "s.jsonl")


def test_an_oedometer_test_is_repeated_from_its_first_axial_stress(tmp_path):
    """It has no radial stress, and its path has no pressure."""
    file, columns = tmp_path / "oedometer.txt", {"axial_stress": ("s", "kPa", "compression"), "void_ratio": ("e", "1")}
    path = lk.paths.Oedometer(strain=0.2)

    def measured(stress):
        file.write_text(f"s e\n{stress} 0.9\n400 0.85\n")
        return {"one": lk.read_measured(file, path, columns, void_ratio=None, **KINDS)}

    lk.GrainTests(measured(25), FREE, SCATTER)
    with pytest.raises(lk.InputError, match="pressure 0 is not above 0"):
        lk.GrainTests(measured(0), FREE, SCATTER)


@pytest.mark.slow
def test_a_sample_repeats_the_test_on_grains_and_a_calibration_resumes(tests, short_chains, tmp_path):
    file = tmp_path / "s.jsonl"
    short = lk.GrainTests(tests.measured, FREE, SCATTER)
    taken = take_sample(short, {"friction": 0.5, "rolling_friction": 0.1}, 100, 1)
    assert taken.failure == "" and 0.5 < taken.points[len(ALONG) - 1] < 2.0  # q/p at the end
    for one in [*imagined_samples(11), taken]:
        append_sample(one, file)
    before = file.read_text()
    found = lk.calibrate_grains(short, samples=12, file=file, grains=100)
    assert len(found.samples) == 12 and file.read_text() == before  # nothing was left to simulate


@pytest.mark.slow
def test_a_density_that_grains_do_not_reach_is_a_failed_sample(tests, tmp_path):
    loose = measured_test(tmp_path)
    loose.data["void_ratio"] = loose.data["void_ratio"] + 1.0
    sample = take_sample(lk.GrainTests({"loose": loose}, FREE, SCATTER), HIDDEN, 100, 1)
    assert sample.points is None and "void ratios of" in sample.failure


@pytest.mark.slow
def test_the_command_goes_on_from_the_stored_samples(tests, short_chains, tmp_path, capsys):
    lk.write_measured(tests.measured["one"], tmp_path / "one.run.nc")
    for one in imagined_samples(16):
        append_sample(one, tmp_path / "s.jsonl")
    free = [f"{name}={low}..{high}" for name, (low, high) in FREE.items()]
    scatter = [f"{name}={value}" for name, value in SCATTER.items()]
    given = ["calibrate-grains", str(tmp_path / "one.run.nc"), "--scatter", *scatter, "--samples", "16"]
    output = ["-o", str(tmp_path / "s.jsonl"), "--csv", str(tmp_path / "posterior.csv")]
    assert main([*given, "--free", *free, *output]) == 0
    assert "16 samples, 0 failed" in capsys.readouterr().out
    assert "rolling_friction" in (tmp_path / "posterior.csv").read_text()
    assert main([*given, "--free", "friction=0.1", *output]) == 2
    assert "LOW..HIGH" in capsys.readouterr().err
