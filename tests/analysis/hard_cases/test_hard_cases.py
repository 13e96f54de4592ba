"""The hard cases in small form on real engines, and proof that their checks can fail."""

import dataclasses
import json
import shutil

import numpy as np
import pytest

import labkit
from analysis import __main__ as studies
from analysis.hard_cases.cases import CASES
from analysis.hard_cases.cases.cycles import cycle_ends, turning_records
from analysis.hard_cases.outcome import examine
from analysis.hard_cases.scenes import CLEAR_ERROR, LIMIT_REPORTED, SCENES, SILENT_WRONG
from labkit.cli.dispatch import main
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state, write_state
from tests.changed import changed

# specimens beyond the limits are hard cases
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:a mean .* is above the limit")]

GRAINS = 120
EXTENT = 0.1  # fraction of the strains of the full cases
ON_YADE = ("isod_to_nothing", "very_loose", "step_over", "fast", "deep_overlaps")

IN_MIXED = ("isod_to_nothing", "step_over", "step_outgrown", "thin_cell")


@pytest.fixture(scope="module")
def examined(tmp_path_factory):
    """Function that examines each small case once: (name, engine) -> (Outcome, folder of its run files)."""
    work, made = tmp_path_factory.mktemp("hard"), {}

    def make(name, engine):
        folder = work / engine / name
        if (name, engine) not in made:
            made[name, engine] = examine(SCENES[name], engine, GRAINS, EXTENT, folder, work / "shared")
        return made[name, engine], folder

    return make


def test_every_scene_has_a_case_of_its_name():
    assert list(SCENES) == list(CASES)


@pytest.mark.parametrize(
    ("name", "precision"), [*((name, "fused") for name in SCENES), *((name, "mixed") for name in IN_MIXED)]
)
def test_no_hard_case_is_silently_wrong_on_fused(name, precision, examined):
    outcome, _ = examined(name, precision)
    assert (outcome.verdict, outcome.failed) == (SCENES[name].verdict, "") and outcome.checks > 1, outcome
    assert outcome.guard or outcome.verdict not in (LIMIT_REPORTED, CLEAR_ERROR)


@pytest.mark.parametrize("name", ON_YADE)
@pytest.mark.yade
def test_no_hard_case_is_silently_wrong_on_yade(name, examined):
    outcome, _ = examined(name, "yade")
    if (name, outcome.verdict) == ("isod_to_nothing", CLEAR_ERROR):  # happens in the gas on some processors
        assert "energy balance" in outcome.guard, outcome
        return
    assert (outcome.verdict, outcome.failed) == (SCENES[name].verdict, "") and outcome.checks > 1, outcome


@pytest.mark.yade
def test_a_cell_too_thin_for_yade_is_one_sentence(tmp_path):
    scene = dataclasses.replace(SCENES["thin_cell"], rate=400.0)
    outcome = examine(scene, "yade", GRAINS, 1.0, tmp_path / "thin", tmp_path / "shared")
    assert outcome.verdict == CLEAR_ERROR
    assert "YADE needs" in outcome.guard and "more grains" in outcome.guard and "\n" not in outcome.guard


@pytest.mark.yade
def test_engines_agree_on_what_is_left_when_all_contacts_are_gone(examined):
    for engine in ("fused", "yade"):
        _, folder = examined("isod_to_nothing", engine)
        last = labkit.open_run(folder / "run.run.nc").isel(time=-1)
        assert not last["stress"].values.any() and last["coordination_number"] == 0.0
        assert np.isnan(last["contact_anisotropy"].values).all() and np.isinf(last["inertial_number"])
        assert last["elastic_energy"] == 0.0 and last["kinetic_energy"] > 0.0


def test_a_cycle_ends_at_its_upper_turn(examined):
    _, folder = examined("many_cycles", "fused")
    run = labkit.open_run(folder / "run.run.nc")
    strain = run["axial_strain"].values[turning_records(run)]
    np.testing.assert_allclose(strain, 5e-4 * np.array([0.0] + [1.0, -1.0] * 10 + [1.0]), atol=2e-6)
    assert len(cycle_ends(run)[0]) == 11


def tamper(file, name, factor):
    """Multiplies the last record of a variable, in a copy that replaces the file: a reader may have it open."""
    copy = file.with_suffix(".copy")
    shutil.copy(file, copy)
    with changed(copy) as dataset:
        dataset[name][-1] = dataset[name][-1] * factor
    copy.replace(file)


@pytest.mark.parametrize(
    ("variable", "factor", "check"),
    [
        ("stress", 1.0 + 1e-6, "stored stress"),
        ("volume", 1.001, "held: volume"),
        ("energy_balance_error", 1e4, "energy balance"),
        ("drift_velocity", 1e3, "drift"),
    ],
)
def test_a_wrong_number_that_nothing_speaks_of_is_found(variable, factor, check, examined, tmp_path):
    outcome, folder = examined("very_dense", "fused")
    assert outcome.verdict == LIMIT_REPORTED
    shutil.copytree(folder, tmp_path / "case")
    tamper(tmp_path / "case" / "run.run.nc", variable, factor)
    shared = folder.parents[1] / "shared"
    outcome = examine(SCENES["very_dense"], "fused", GRAINS, EXTENT, tmp_path / "case", shared)
    assert outcome.verdict == SILENT_WRONG and check in outcome.failed


def test_a_run_that_does_not_say_its_limit_is_found(tmp_path):
    """The scene `fast` at the quasi-static rate exceeds no limit, so the required report is missing."""
    scene = dataclasses.replace(SCENES["fast"], rate=10.0)
    outcome = examine(scene, "fused", GRAINS, 0.02, tmp_path / "case", tmp_path / "shared")
    assert outcome.verdict == SILENT_WRONG and "inertial number" in outcome.failed


def hard_cases(tmp_path, *options):
    places = ["-o", str(tmp_path / "out"), "--work", str(tmp_path / "work")]
    return studies.main(["hard-cases", *options, "--engine", "fused", "--grains", str(GRAINS), *places])


def test_the_command_writes_a_page_redraws_it_goes_on_and_fails_for_a_wrong_answer(tmp_path, capsys):
    names = ("isoc_beyond", "very_loose")
    assert hard_cases(tmp_path, *names) == 0
    out = tmp_path / "out"
    assert (out / "hard_cases.png").read_bytes()[:4] == b"\x89PNG"
    lines = (out / "hard_cases.csv").read_text().splitlines()
    assert lines[0].startswith("case,engine,should,did,verdict") and len(lines) == 3
    page = (out / "README.md").read_text()
    assert "./lab hard-cases isoc_beyond very_loose" in page and "0 silently wrong" in page
    assert all(f"### {name}\n" in page for name in names)

    # the same page is written from the table alone
    (out / "README.md").unlink()
    assert studies.main(["hard-cases", "--redraw", "-o", str(out)]) == 0
    assert (out / "README.md").read_text() == page
    capsys.readouterr()

    # finished cases are kept and not run again
    case = tmp_path / "work" / f"n{GRAINS}" / "fused" / "isoc_beyond"
    before = (case / "run.run.nc").stat().st_mtime_ns
    assert hard_cases(tmp_path, *names) == 0
    assert (out / "hard_cases.csv").read_text().splitlines() == lines
    assert (case / "run.run.nc").stat().st_mtime_ns == before

    # the outcome of another scene is discarded; the run file, which is kept, now holds a wrong stress
    kept = json.loads((case / "outcome.json").read_text())
    kept["scene"]["rate"] = 1.0
    (case / "outcome.json").write_text(json.dumps(kept))
    tamper(case / "run.run.nc", "stress", 1.01)
    capsys.readouterr()
    assert hard_cases(tmp_path, *names) == 1
    assert "SILENT WRONG" in capsys.readouterr().out and "1 silently wrong" in (out / "README.md").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["nonsense"], "choose from loose_cv"),
        (["very_loose", "--grains", "7"], "give 100"),
        (["very_loose", "--work", "FILE"], "choose another"),
        (["--redraw"], "contains no hard_cases.csv"),
    ],
)
def test_bad_input_is_one_line(options, message, tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("")
    options = [option.replace("FILE", str(file)) for option in options]
    work = [] if "--work" in options else ["--work", str(tmp_path / "w")]
    assert studies.main(["hard-cases", *options, *work, "--engine", "fused", "-o", str(tmp_path / "o")]) == 2
    error = capsys.readouterr().err
    assert message in error and len(error.strip().splitlines()) == 1


def test_a_study_of_cases_without_runs_has_no_figure(tmp_path, capsys):
    assert hard_cases(tmp_path, "very_loose") == 0
    assert {p.name for p in (tmp_path / "out").iterdir() if p.suffix != ".json"} == {"README.md", "hard_cases.csv"}


def test_contacts_that_a_state_does_not_list_are_in_the_balance_from_the_start(tmp_path):
    """The elastic energy of another program's grains, listed without contacts, counts before the first step."""
    scene = Scene()
    specimen = labkit.make_specimen(labkit.Recipe(0.67, 0.15, grains=GRAINS), scene)
    nothing = np.zeros((0, 3))
    bare = specimen.replace(
        contact_grain=np.zeros((0, 2), np.int32),
        contact_shift=nothing.astype(np.int32),
        tangential_force=nothing,
        rolling_moment=nothing,
    )
    write_state(tmp_path / "bare.state.nc", bare)
    file = tmp_path / "bare.run.nc"
    words = "--strain", "0.005", "--engine", "fused", "-o", str(file)
    assert main(["run", "cv", str(tmp_path / "bare.state.nc"), *words]) == 0
    run = labkit.open_run(file)
    assert run["elastic_energy"][0] > 0.0 and np.abs(run["energy_balance_error"]).max() < 0.02
    assert float(run["coordination_number"][0]) * len(bare.radius) / 2 == len(specimen.contact_grain)
    assert len(read_state(tmp_path / "bare.state.nc").contact_grain) == 0
