"""Earlier results after a change of the campaign file, and runs that continue from others."""

import json
import os

import pytest

from labkit.cli import main
from labkit.errors import InputError
from labkit.plugins.campaigns.file import read_campaign
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.campaigns.layout import OUTDATED, output_of, recipe_of
from labkit.plugins.campaigns.plan import require_campaign_folder, unfinished_jobs, write_plan
from tests.full_disk import file_size_limit

TEXT = """\
engine: fused
specimens:
  a: {void_ratio: 0.67, grains: 150}
  b: {void_ratio: 0.70, grains: 150}
runs:
  cv: {path: cv, specimen: [a, b], strain: 0.01}
"""


def outputs(folder, plan):
    return {output_of(job) for job in plan.jobs if (folder / output_of(job)).exists()}


def test_results_of_earlier_parameters_are_set_aside(tmp_path):
    """They are moved at once, so that they do not count as finished if a job that they depend on fails now."""
    file = tmp_path / "c.yaml"
    file.write_text(TEXT)
    plan = read_campaign(file)
    write_plan(plan, tmp_path)
    made = [output_of(job) for job in plan.jobs] + ["statistics/cv-a.nc", "figures/cv-a.png", "figures/cv-b.png"]
    for name in made:
        (tmp_path / name).write_text(name)
    write_plan(plan, tmp_path)
    assert outputs(tmp_path, plan) == {output_of(job) for job in plan.jobs}

    file.write_text(TEXT.replace("0.67", "0.68"))
    changed = read_campaign(file)
    write_plan(changed, tmp_path)
    assert outputs(tmp_path, changed) == {"specimens/b.state.nc", "runs/cv-b.run.nc"}
    assert {p.name for p in (tmp_path / OUTDATED).iterdir()} == {"a.state.nc", "cv-a.run.nc", "cv-a.nc", "cv-a.png"}
    assert (tmp_path / "figures/cv-b.png").exists()


CHAIN = """\
engine: fused
specimens:
  a: {void_ratio: 0.67, grains: 150}
runs:
  shear: {path: cr, specimen: a, pressure: [100 kPa, 200 kPa], strain: 0.01, friction: 0.3}
  unload: {path: cr, specimen: shear, strain: -0.005}
"""


def test_runs_go_on_from_earlier_runs(tmp_path):
    """Each run continues from the end of the previous one, in its scene; a file that names a later run is refused."""
    file = tmp_path / "c.yaml"
    file.write_text(CHAIN)
    campaign = read_campaign(file)
    first, second = campaign.runs[2:]
    assert len(campaign.consolidations) == 2
    assert first.name == "unload-shear-p100kPa" and first.source == "runs/shear-p100kPa.run.nc"
    assert second.name == "unload-shear-p200kPa" and second.source == "runs/shear-p200kPa.run.nc"
    assert first.scene.friction == second.scene.friction == 0.3
    assert "--friction" not in first.command and "--friction=0.3" in campaign.runs[0].command
    lines = CHAIN.splitlines()
    file.write_text("\n".join([*lines[:4], lines[5], lines[4], ""]))
    with pytest.raises(InputError, match="there is no specimen 'shear'"):
        read_campaign(file)


@pytest.mark.parametrize("left", [b"", b'{"command": ["lab', b"\xff\xfe"])
def test_a_recipe_that_a_full_disk_cut_off_is_written_again(left, tmp_path):
    """Version 0.2 wrote recipes in place; the same command must still be able to continue."""
    file = tmp_path / "c.yaml"
    file.write_text(TEXT)
    plan = read_campaign(file)
    write_plan(plan, tmp_path)
    recipe = tmp_path / recipe_of(plan.jobs[0])
    whole = recipe.read_bytes()
    recipe.write_bytes(left)
    require_campaign_folder(plan, tmp_path)
    write_plan(plan, tmp_path)
    assert recipe.read_bytes() == whole


def test_recipes_are_written_whole_or_not_at_all(tmp_path):
    file = tmp_path / "c.yaml"
    file.write_text(TEXT)
    plan = read_campaign(file)
    write_plan(plan, tmp_path)
    before = {recipe_of(job): (tmp_path / recipe_of(job)).read_bytes() for job in plan.jobs}
    file.write_text(TEXT.replace("0.67", "0.68"))
    with file_size_limit(10), pytest.raises(OSError, match="File too large") as failure:
        write_plan(read_campaign(file), tmp_path)
    assert failure.value.filename is not None
    assert {recipe_of(job): (tmp_path / recipe_of(job)).read_bytes() for job in plan.jobs} == before
    assert not list(tmp_path.rglob("*.tmp"))


def test_a_dry_run_lists_what_is_left(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.yaml").write_text(TEXT)
    plan = read_campaign(tmp_path / "c.yaml")
    write_plan(plan, tmp_path / "c")

    def said():
        assert main(["campaign", "c.yaml", "--dry-run"]) == 0
        return capsys.readouterr().out

    assert "are finished" not in said()
    for job in plan.jobs[:3]:
        (tmp_path / "c" / output_of(job)).touch()
    text = said()
    assert "3 of 4 jobs are finished; this is what is left" in text and "cv-b " in text and "cv-a " not in text
    (tmp_path / "c" / output_of(plan.jobs[3])).touch()
    assert said() == "2 specimens, 0 consolidations, 2 runs: all are finished, nothing is left to do\n"
    assert [job.name for job in unfinished_jobs(plan, tmp_path / "elsewhere")] == ["a", "b", "cv-a", "cv-b"]


OLD = """\
threads: 2
use: own.py
specimens:
  a: {void_ratio: 0.67, grains: 150}
  b: {void_ratio: 0.70, grains: 150}
runs:
  cp: {path: cp, specimen: [a, b], strain: 0.01, pressure: 100 kPa}
"""


@pytest.fixture
def finished(tmp_path, monkeypatch):
    """A finished campaign."""
    monkeypatch.setenv("LABKIT_USE", "")
    (tmp_path / "own.py").write_text("")
    (tmp_path / "c.yaml").write_text(OLD)
    plan = read_campaign(tmp_path / "c.yaml")
    write_plan(plan, tmp_path)
    for job in plan.jobs:
        os.utime(tmp_path / recipe_of(job), (1e9, 1e9))
        (tmp_path / output_of(job)).touch()
    return plan


def test_results_of_a_plan_that_is_written_otherwise_are_kept(finished, tmp_path):
    for job in finished.jobs:
        recipe = json.loads((tmp_path / recipe_of(job)).read_text())
        (tmp_path / recipe_of(job)).write_text(json.dumps({**recipe, "command": "labkit"}))
        os.utime(tmp_path / recipe_of(job), (1e9, 1e9))
    assert unfinished_jobs(finished, tmp_path) == []
    assert write_plan(finished, tmp_path) == ["6 results of the same jobs, planned differently, are kept"]
    assert outputs(tmp_path, finished) == {output_of(job) for job in finished.jobs}
    for job in finished.jobs:
        assert (tmp_path / recipe_of(job)).stat().st_mtime == 1e9  # no tool considers the result out of date
        assert Job.from_values(json.loads((tmp_path / recipe_of(job)).read_text())) == job
    assert write_plan(finished, tmp_path) == []


def test_results_of_other_parameters_are_moved(finished, tmp_path):
    (tmp_path / "c.yaml").write_text(OLD.replace("0.67", "0.68"))
    changed = read_campaign(tmp_path / "c.yaml")
    assert write_plan(changed, tmp_path) == [f"3 results of other parameters are moved to {tmp_path / OUTDATED}"]
    assert outputs(tmp_path, changed) == {
        "specimens/b.state.nc",
        "specimens/b-at-p100kPa-fused.state.nc",
        "runs/cp-b.run.nc",
    }


def test_the_number_of_threads_changes_no_result_of_fused(finished, tmp_path):
    (tmp_path / "c.yaml").write_text(OLD.replace("threads: 2", "threads: 4"))
    assert unfinished_jobs(read_campaign(tmp_path / "c.yaml"), tmp_path) == []
    (tmp_path / "c.yaml").write_text(OLD.replace("threads: 2", "engine: yade\nthreads: 4"))
    assert len(unfinished_jobs(read_campaign(tmp_path / "c.yaml"), tmp_path)) == 6
