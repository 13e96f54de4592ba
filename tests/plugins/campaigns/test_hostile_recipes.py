"""Recipes and plans that labkit did not write: nothing in them is executed, and one sentence says what to do."""

import json
import os

import pytest

from labkit.errors import InputError
from labkit.extensions import VARIABLE
from labkit.plugins.campaigns.file import copy_campaign, read_campaign
from labkit.plugins.campaigns.job import run_job
from labkit.plugins.campaigns.layout import read_plan
from labkit.plugins.campaigns.plan import write_plan

TEXT = """
use: {use}
specimens: {{a: {{void_ratio: 0.67, grains: 120}}}}
runs: {{cv: {{path: cv, specimen: a, strain: 0.01}}}}
"""
OWN = "from pathlib import Path\nPath({hit!r}).touch()\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of a campaign, the current folder, and the file that its user's file touches."""
    monkeypatch.setenv(VARIABLE, "")
    (tmp_path / "own.py").write_text(OWN.format(hit=str(tmp_path / "own was executed")))
    (tmp_path / "evil.py").write_text(OWN.format(hit=str(tmp_path / "evil was executed")))
    (tmp_path / "c.yaml").write_text(TEXT.format(use="own.py"))
    campaign = read_campaign(tmp_path / "c.yaml")
    (tmp_path / "own was executed").unlink()
    write_plan(campaign, tmp_path / "c")
    copy_campaign(campaign, (tmp_path / "c.yaml").read_text(), tmp_path / "c")
    write_plan(campaign, tmp_path / "c")
    monkeypatch.chdir(tmp_path / "c")
    return tmp_path


@pytest.fixture
def recipe(folder):
    return folder / "c/recipes/run.cv.json"


def log(folder):
    return (folder / "c/logs/run.cv.log").read_text()


@pytest.mark.parametrize("use", [["../evil.py"], ["extensions/own.py", "../evil.py"], "../evil.py", [["../evil.py"]]])
def test_only_files_that_the_campaign_file_names_are_executed(use, folder, recipe):
    recipe.write_text(json.dumps({**json.loads(recipe.read_text()), "use": use}))
    assert run_job("run", "cv") == 2 and "repeat labkit campaign" in log(folder)
    assert not list(folder.glob("* was executed"))


def test_a_file_that_the_campaign_file_names_is_executed(folder):
    assert run_job("run", "cv") == 2 and "specimens/a.state.nc does not exist" in log(folder)


BROKEN = {
    "bytes": b"\xff\xfe",
    "digits": b'{"use": [], "name": ' + 5000 * b"1" + b"}",
    "depth": 100_000 * b"[",
    "list": b"[]",
    "no task": {"task": None},
    "no device": {"task": {}},
    "wrong device": {"task": {"device": {"cores": 1}}},
    "wrong path": {"task": {"device": {}, "scene": {}, "options": {}, "path": {"speed": 1}}},
    "wrong scene": {"task": {"device": {}, "scene": [], "options": {}}},
}


@pytest.mark.parametrize("change", BROKEN.values(), ids=BROKEN)
def test_a_broken_recipe_is_said_in_one_sentence(change, folder, recipe, capsys):
    values = json.loads(recipe.read_text())
    recipe.write_bytes(change if isinstance(change, bytes) else json.dumps({**values, **change}).encode())
    assert run_job("run", "cv") == 2
    assert log(folder).splitlines() == [
        "labkit: recipes/run.cv.json cannot be read: repeat labkit campaign, which writes it"
    ]


def test_a_pipe_in_place_of_a_recipe_or_a_plan_is_refused(folder, recipe):
    for file in (recipe, folder / "c/plan.json"):
        file.unlink()
        os.mkfifo(file)
    assert run_job("run", "cv") == 2 and "not a regular file" in log(folder)
    with pytest.raises(InputError, match=r"plan\.json does not fit"):
        read_plan()


@pytest.mark.parametrize(
    "change", [{"files": {}}, {"files": []}, {"jobs": [["run", "../../x"]]}, {"jobs": [["run", 1]]}]
)
def test_a_plan_that_labkit_did_not_write_is_refused(change, folder):
    plan = folder / "c/plan.json"
    assert [row.name for row in read_plan(current=True)] == ["a", "cv"]
    plan.write_text(json.dumps({**json.loads(plan.read_text()), **change}))
    with pytest.raises(InputError, match=r"plan\.json does not fit the campaign"):
        read_plan(current=True)


def test_the_reason_of_a_failure_is_no_markdown_in_the_report(folder, recipe):
    values = json.loads(recipe.read_text())
    values["task"]["source"] = "`[a](http://b)<img>\x1b[2K"
    recipe.write_text(json.dumps(values))
    assert run_job("run", "cv") == 2 and run_job("report") == 0
    (line,) = (line for line in (folder / "c/report.md").read_text().splitlines() if "img" in line)
    assert line.startswith("- run `cv`: `") and line.endswith("`") and line.count("`") == 4 and r"\x1b" in line
