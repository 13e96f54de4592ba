"""The design covers all factors, and its standard settings are the defaults of the commands."""

import dataclasses

import pytest

from analysis.speed_error.design import BASELINE, DESIGNS, MIXED, PRESET, read_design
from labkit.cli.dispatch import parse
from labkit.paths.rates import on_grains
from labkit.specimens.recipe import SETTINGS


@pytest.mark.parametrize("name", DESIGNS)
def test_cases_have_names_of_their_own_and_something_to_be_compared_with(name):
    design = read_design(name)
    names = [case.name for case in design.cases]
    assert len(set(names)) == len(names)
    for path in {case.path for case in design.cases}:
        assert design.baseline(path).factor == BASELINE and design.of_settings("reference", path).level == "reference"


def test_a_factor_is_varied_alone():
    """Each case of one factor differs from the baseline only in that factor."""
    design = read_design("full")
    base = design.baseline()
    several = (PRESET, MIXED, BASELINE, "law", "rolling")
    for case in design.cases:
        if case.path == "cp" and " x " not in case.factor and case.factor not in several:
            shared = {"factor", "level", "guarded", "seeds"}
            different = {f.name for f in dataclasses.fields(case) if getattr(case, f.name) != getattr(base, f.name)}
            assert len(different - shared) + max(0, len(case.scene) - 1) <= (3 if case.factor == "engine" else 1), case


def specimen_task(*options):
    return parse(["specimen", "--void-ratio", "0.67", *options])[1]["task"]


def run_task(path, file, *options):
    return parse(["run", path, str(file), "-o", "x.run.nc", *options])[1]["task"]


def test_standard_is_what_the_commands_do_without_options(specimen_file):
    plain, standard = specimen_task(), specimen_task("--settings", "standard")
    assert (plain.recipe, plain.material) == (standard.recipe, standard.material)
    side = plain.recipe.side_of(plain.material)
    assert (side, plain.material.time_step_factor) == (SETTINGS["standard"].side, 0.2)
    plain, standard = run_task("cv", specimen_file), run_task("cv", specimen_file, "--settings", "standard")
    assert on_grains(plain.path, plain.scene) == standard.path and plain.scene == standard.scene


def test_settings_change_size_rate_and_time_step(specimen_file):
    quick, task = SETTINGS["quick"], specimen_task("--settings", "quick")
    assert task.recipe.side_of(task.material) < SETTINGS["standard"].side
    assert task.material.time_step_factor == quick.time_step_factor
    task = run_task("isoc", specimen_file, "--settings", "quick")
    assert task.path.rate == pytest.approx(5.0 * quick.rate_factor) and task.scene.time_step_factor == 0.3
    task = run_task("isoc", specimen_file, "--settings", "quick", "--rate", "7", "--time-step-factor", "0.1")
    assert task.path.rate == 7.0 and task.scene.time_step_factor == 0.1
