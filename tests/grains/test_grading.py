"""Gradings against the closed forms of their distributions."""

import math

import numpy as np
import pytest

import labkit as lk
from labkit.engines.fused import FusedEngine
from labkit.errors import InputError
from labkit.grains.grading import Lognormal, RosinRammler, Sieve, Uniform, read_grading
from labkit.grains.scene import Scene
from labkit.grains.time_step import critical_time_step
from labkit.micro.void_ratio import grain_volume
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import insert_grains

TEXTS = (
    "uniform smallest=0.1mm largest=0.4mm by=number",
    "uniform smallest=0.1mm largest=1mm by=mass",
    "lognormal median=0.2mm sigma=0.3 smallest=0.1mm largest=0.5mm",
    "rosin_rammler scale=0.25mm exponent=4 smallest=0.1mm largest=0.5mm by=number",
    "sieve diameters=0.1mm,0.2 mm,0.4mm passing=0%,45%,100%",
)


@pytest.mark.parametrize("text", TEXTS)
def test_a_grading_survives_its_text_and_a_scene_its_json(text):
    grading = read_grading(text)
    assert read_grading(grading.to_text()) == grading
    scene = Scene(grading=text)
    assert Scene.from_json(scene.to_json()) == scene and scene.sizes == grading
    assert scene.mean_diameter == grading.mean_diameter


def test_moments_of_uniform_distributions_by_number_and_by_mass():
    a, b = 1e-4, 4e-4
    number, mass = Uniform(a, b), Uniform(a, b, by="mass")
    assert np.isclose(number.mean_diameter, (a + b) / 2, rtol=1e-6)
    assert np.isclose(number.mean_volume, np.pi / 6 * (a + b) * (a**2 + b**2) / 4, rtol=1e-6)
    assert np.isclose(mass.mean_diameter, 2 * a * b / (a + b), rtol=1e-5)  # dN ~ dD/D^3
    assert np.isclose(mass.mean_volume, np.pi / 6 * 2 * (a * b) ** 2 / (a + b), rtol=1e-5)
    assert np.isclose(mass.percentile(0.5), 2.5e-4, rtol=1e-6)


def test_a_lognormal_by_mass_is_lognormal_by_number_with_a_shifted_median():
    """Hatch and Choate: ln median by number = ln median by mass - 3 sigma^2; cut far out in the tails."""
    wide = Lognormal(0.17e-3 / 3.1, 0.17e-3 * 3.1, median=0.17e-3, sigma=0.25)
    assert np.isclose(wide.percentile(0.5, "number"), 0.17e-3 * math.exp(-3 * 0.25**2), rtol=2e-3)


def test_rosin_rammler_and_sieve_pass_the_stated_shares():
    rosin = RosinRammler(0.05e-3, 0.5e-3, scale=0.2e-3, exponent=5.0)
    assert np.isclose(rosin.percentile(1 - 1 / math.e), 0.2e-3, rtol=2e-3)
    sieve = Sieve(diameters=(1e-4, 2e-4, 4e-4), passing=(0.0, 0.45, 1.0))
    assert np.isclose(sieve.percentile(0.45), 2e-4, rtol=1e-6)
    assert np.isclose(sieve.percentile(0.225), 1e-4 * math.sqrt(2), rtol=1e-3)  # linear in ln D


@pytest.mark.parametrize("text", TEXTS)
def test_drawn_grains_follow_the_curve_and_fill_the_volume(text):
    grading = read_grading(text)
    volume = 800 * grading.mean_volume
    radius = np.sort(grading.draw(volume, np.random.default_rng(2)))
    assert np.isclose(grain_volume(radius), volume, rtol=1e-12)
    by_number = np.interp(2 * radius, grading.table.diameter, grading.table.by_number)
    assert np.abs(by_number - (np.arange(len(radius)) + 0.5) / len(radius)).max() < 0.02
    passing = np.cumsum(radius**3) / np.sum(radius**3)
    largest = radius[-1] ** 3 / np.sum(radius**3)
    error = np.interp(2 * radius, grading.table.diameter, grading.table.by_mass) - passing
    assert np.abs(error).max() < 0.02 + largest


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gaussian mean=1mm", "'gaussian' .* uniform"),
        ("uniform smallest=1mm largest=11mm", "at most 10 times"),
        ("uniform smallest=1mm", "is not complete: give largest"),
        ("uniform smallest=1mm largest=2mm width=3", "is not a value of this grading"),
        ("sieve diameters=1mm,2mm passing=0,50", "the last 1"),
        ("sieve diameters=2mm,1mm passing=0,1", "ascending"),
        ("missing.csv", "cannot be read"),
    ],
)
def test_invalid_gradings_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        Scene(grading=text)


def test_a_mean_diameter_and_a_grading_are_refused_together():
    with pytest.raises(InputError, match="no mean diameter with a grading"):
        Scene(grading=TEXTS[0], mean_diameter=3e-4)


def test_the_time_step_follows_the_smallest_grain():
    """In the grading of Table 1 it is that of the mean grain; in a wide one it scales with the smallest grain."""
    assert Scene().time_step == 0.2 * Scene().time_unit
    for law in ("rolling_resistance", "hertz_mindlin"):
        scene = Scene(grading="uniform smallest=0.05mm largest=0.5mm by=mass", law=law)
        assert scene.time_step < 0.7 * 0.2 * scene.time_unit


@pytest.mark.slow
def test_the_time_step_is_stable_in_a_wide_grading():
    scene = Scene(grading="uniform smallest=0.05mm largest=0.3mm by=mass")
    recipe = Recipe(void_ratio=0.8, grains=400)
    inserted = insert_grains(scene, recipe)
    assert inserted.radius.max() / inserted.radius.min() > 5.5
    volume = recipe.side_of(scene) ** 3
    assert np.isclose(volume / grain_volume(inserted.radius) - 1, 0.8, rtol=1e-9)
    assert scene.time_step < critical_time_step(
        FusedEngine(inserted).state()
    )  # deep overlaps: more contacts than later


def test_a_blank_grading_is_refused():
    with pytest.raises(lk.InputError, match="grading is empty: give one of uniform"):
        lk.Scene(grading=" ")


CURVE = "sieve diameters=0.1mm,0.2mm,0.4mm passing=0%,45%,100%"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize(
    "text",
    [
        "diameter_mm,passing_percent\n0.4,100\n0.2,45\n0.1,0\n",
        "Laboratory of soils\n12 March\n\nSieve size (mm);Percentage passing (%)\n0,1;0\n0,2;45\n0,4;100\n",
        "Passing [-],Sieve opening [\u00b5m]\n0,100\n0.45,200\n1.0,400\n",
        "diameter_mm\tmass\tpassing_fraction\n1.0D-01\t3\t0\n0.2\t4\t0.45\n0.4\t5\t1\n",
        "particle diameter\tfiner\nmm\t%\n0.1\t0\n0.2\t45\n0.4\t100\n",
    ],
)
def test_sieve_curves_of_laboratories(tmp_path, text, encoding):
    folder = tmp_path / "my data"
    folder.mkdir()
    (folder / "curve 1.csv").write_bytes(text.encode(encoding))
    found, expected = read_grading(str(folder / "curve 1.csv")), read_grading(CURVE)
    np.testing.assert_allclose(found.diameters, expected.diameters, rtol=1e-12)
    assert found.passing == expected.passing


@pytest.mark.parametrize(
    "text, message",
    [
        ("diameter_mm,passing_percent\n0.075,4\n0.2,45\n0.4,100\n", "passes 0.04 of 1 at its smallest and 1 at"),
        ("diameter_mm,passing_percent\n0.075,0\n0.2,45\n0.4,97\n", "0.97 at its largest diameter"),
        ("diameter_mm,passing_percent\n0.1,0\n0.2,95\n0.3,45\n0.4,100\n", "is not a sieve curve"),
        ("diameter_mm,passing_percent\n0.1,0\n0.2,none\n0.4,100\n", "is not a sieve curve"),
        ("diameter,passing\n0.1,0\n0.4,100\n", "headings diameter_mm"),
        ("PK\x03\x04 a workbook", "Excel workbook: save its table as CSV"),
    ],
)
def test_messages_on_sieve_curves_name_the_file(tmp_path, text, message):
    (tmp_path / "curve.csv").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_grading(str(tmp_path / "curve.csv"))
    assert error.value.field == "grading" and "--passing" not in str(error.value)


def test_a_sieve_curve_is_read_again_when_its_file_changes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    means = []
    for low, high in ((0.1, 0.2), (0.3, 0.6)):
        (tmp_path / "curve.csv").write_text(f"diameter_mm,passing_percent\n{low},0\n{high},100\n")
        means.append(lk.Scene(grading="curve.csv").mean_diameter)
    assert np.isclose(means[1], 3 * means[0])
