"""A campaign with a user-defined path, law and statistic: validated, carried out, repeated when the file changes."""

import json
import os
import shutil
import subprocess
import sys

import netCDF4
import numpy as np
import pytest

import labkit
from labkit.extensions import VARIABLE
from labkit.plugins.campaigns.file import copied_names, with_use
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

OWN = """\
import dataclasses

import numpy as np

from labkit.paths.control import Control
from labkit.paths.path import Path
from labkit.paths.registry import register_path
from labkit.quantities.recorded import register_statistic
from labkit.parameters import parameter


@register_path
@dataclasses.dataclass(frozen=True)
class ConstantAxialStress(Path):
    strain: float = parameter(0.1, above=0.0, high=1.0, help="axial strain to reach")
    axial: float | None = parameter(None, unit="Pa", above=0.0, help="sigma_z to hold")
    share: float = parameter(0.5, low=0.0, high=1.0, help="of the extension in x")

    name = "constant_axial_stress"
    direction = (-1.0, -1.0, 0.0)
    shear = True

    def control(self):
        z = np.eye(3)[2:]
        return Control(z, z.T, np.array([self.axial]))

    def start_pressure(self):
        return self.axial


@register_statistic("sliding", long_name="share of contacts that slide")
def sliding(snapshot):
    contacts = snapshot.contacts
    limit = snapshot.scene.friction * contacts.normal_force
    return np.mean(np.linalg.norm(contacts.tangential_force, axis=1) > 0.999 * limit)
"""
OWN_RUN = "  own: {path: constant_axial_stress, specimen: a, strain: 0.005, axial: 400 kPa, share: 40 %, law: linear}\n"
FILE = f"""\
use: [files/own.py, files/law.py]    # a comment that stays
settings: quick
engine: fused
snapshots: 1
specimens:
  a: {{void_ratio: 0.606, step1_friction: 0.06, grains: 120}}
runs:
{OWN_RUN}  cv: {{path: cv, specimen: a, strain: 0.005}}
"""


def write(folder, text=FILE, own=OWN):
    (folder / "files").mkdir(exist_ok=True)
    (folder / "files/own.py").write_text(own)
    shutil.copy(ROOT / "examples/own_law.py", folder / "files/law.py")
    (folder / "c.yaml").write_text(text)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, labkit_command):
    """The campaign, finished, in the folder `c` next to its file."""
    pytest.importorskip("snakemake", reason="needs Snakemake, the extra `campaign`")
    folder = tmp_path_factory.mktemp("own")
    write(folder)
    done = labkit_command("campaign", "c.yaml", "--cores", 1, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 of 2 runs" in done.stdout
    return folder


@pytest.fixture
def place(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "copy")


def test_a_user_defined_path_is_run_with_a_user_defined_law_and_a_statistic_recorded(finished):
    with netCDF4.Dataset(finished / "c/runs/own.run.nc") as run:
        assert run.getncattr("path") == "constant_axial_stress" and run.complete
        assert json.loads(run.scene)["law"] == "linear"
        known = json.loads(run.path_parameters)
        assert (known["axial"], known["share"], known["strain"]) == (400e3, 0.4, 0.005)
        stress, share = run["stress"][:, 2, 2], run["sliding"][:]
        assert np.abs(stress / 400e3 - 1.0).max() < 0.02 and run["sliding"].long_name == "share of contacts that slide"
        assert 0.0 <= share.min() < share.max() <= 1.0
    report = (finished / "c/report.md").read_text()
    assert "| own | constant_axial_stress | fused | a |" in report
    with netCDF4.Dataset(finished / "c/statistics/own.nc") as found:
        assert float(found["final_sliding"][...]) == float(share[-1]) and "critical_M" in found.variables


def test_the_runs_as_one_object_have_the_parameters_of_the_path_and_the_statistic(finished):
    """This also holds in a process that does not load the user's file."""
    campaign = labkit.open_campaign(finished / "c")
    assert campaign["axial"].sel(run="own") == 400e3 and np.isnan(campaign["axial"].sel(run="cv"))
    assert campaign["target_strain"].values == pytest.approx([0.005, 0.005])
    assert campaign["strain"].dims == ("run", "time", "i", "j") and campaign["sliding"].dims == ("run", "time")
    assert campaign["sliding"].attrs["long_name"] == "share of contacts that slide"
    assert np.isfinite(campaign.runs.summary()["final_sliding"]).all()


def test_the_folder_contains_all_that_it_needs(place, labkit_command):
    text = (place / "c/campaign.yaml").read_text()
    assert text.splitlines()[0] == 'use: ["extensions/own.py", "extensions/law.py"]    # a comment that stays'
    assert text.splitlines()[1:] == FILE.splitlines()[1:]
    assert (place / "c/extensions/own.py").read_text() == OWN
    shutil.rmtree(place / "files")
    moved, before = (place / "c").rename(place / "moved"), times(place / "moved")
    done = labkit_command("campaign", "moved/campaign.yaml", "--folder", moved, "--cores", 1, cwd=place)
    assert done.returncode == 0, done.stderr
    assert "Nothing to be done" in (moved / "logs/snakemake.log").read_text() and times(moved) == before


def times(folder):
    return {f.name: f.stat().st_mtime_ns for kind in ("specimens", "runs") for f in (folder / kind).iterdir()}


PLANNED_AGAIN = """
from pathlib import Path
from labkit.plugins.campaigns.file import read_campaign
from labkit.plugins.campaigns.plan import unfinished_jobs, write_plan

campaign, folder = read_campaign(Path("c.yaml")), Path("c")
print(*(job.name for job in unfinished_jobs(campaign, folder)), *write_plan(campaign, folder), sep="|")
"""


def test_a_changed_file_repeats_what_depends_on_it(place):
    """Here a run that records the statistic; in a process of its own, because it loads the user's file."""
    write(place, FILE.replace(OWN_RUN, ""), OWN.replace("0.999", "0.99"))
    environment = {**os.environ, VARIABLE: "", "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-c", PLANNED_AGAIN]
    done = subprocess.run(words, cwd=place, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "cv|1 results of other parameters are moved to c/outdated"
    assert (place / "c/outdated/cv.run.nc").exists() and not (place / "c/runs/cv.run.nc").exists()


def errors(labkit_command, folder):
    done = labkit_command("campaign", "c.yaml", "--dry-run", cwd=folder)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    return done.stderr.splitlines()[1:]


def test_invalid_keys_of_a_user_defined_path_are_reported_with_their_lines(tmp_path, labkit_command):
    runs = (
        "  one: {path: constant_axial_stress, specimen: a,\n    axial: 40}\n"
        "  two: {path: constant_axial_stress, specimen: a, share: 2}\n"
        "  three: {path: constant_axial_stress, specimen: a,\n    axal: 1 MPa}\n"
        "  four: {path: cv, specimen: a, share: 0.1}\n"
        "  five: {path: constant_axial_stress, specimen: a, axial: 1 mm}\n"
    )
    write(tmp_path, FILE.partition("  own:")[0] + runs)
    said = ("9: run one: axial 40 ", "10: run two: share 2 ", "12: run three: 'axal' ", "13: run four: share ")
    lines = errors(labkit_command, tmp_path)
    for line, beginning in zip(lines, (*said, "14: run five: axial 1 mm "), strict=True):
        assert line.startswith(f"  line {beginning}"), lines
    assert "40 MPa or kPa" in lines[0] and "'axial'" in lines[2]


def test_a_required_parameter_and_a_rule_of_the_path(tmp_path, labkit_command):
    own = OWN.replace("@dataclasses.dataclass(frozen=True)", "@dataclasses.dataclass(frozen=True, kw_only=True)")
    own = own.replace("axial: float | None = parameter(None, unit", "axial: float = parameter(unit").replace(
        "    name = ",
        """    def __post_init__(self):
        super().__post_init__()
        if self.share == 0.3:
            raise ValueError("this share is not for me")

    name = """,
    )
    runs = (
        "  one: {path: constant_axial_stress, specimen: a}\n"
        "  two: {path: constant_axial_stress, specimen: a, axial: 50 Pa, share: 0.3}\n"
        "  three: {path: constant_axial_stress, specimen: a, axial: 50 Pa, rate: 1e-9 1/s}\n"
    )
    write(tmp_path, FILE.partition("  own:")[0] + runs, own)
    one, two, three = errors(labkit_command, tmp_path)
    assert one.startswith("  line 8: run one: axial ") and one.endswith("0.5 MPa or 500 kPa")
    assert two == "  line 9: run two: this share is not for me"
    assert three.startswith("  line 10: run three: rate 1e-09 gives ")


@pytest.mark.parametrize(
    "own, message",
    [
        ("import nothing_like_this\n", "(own.py line 1: ModuleNotFoundError"),
        ("def (:\n", "(SyntaxError"),
        (OWN.replace('name = "constant_axial_stress"', 'name = "cp"'), "name cp "),
    ],
)
def test_a_file_that_cannot_be_loaded_is_the_only_error(own, message, tmp_path, labkit_command):
    write(tmp_path, own=own)
    (line,) = errors(labkit_command, tmp_path)
    assert line.startswith("  line 1: the file: use ") and message in line


def test_files_of_the_command_line_are_those_of_the_campaign(place, labkit_command):
    """With --use instead of `use:`, the folder is complete as well, and the existing results are kept."""
    write(place, FILE.partition("\n")[2].replace("runs:\n", "runs:  # one\n").partition("  cv:")[0])
    before = times(place / "c")
    use = ("--use", "files/own.py", "--use", "files/law.py")
    done = labkit_command("campaign", "c.yaml", *use, "--cores", 1, cwd=place)
    assert done.returncode == 0 and "1 of 1 runs" in done.stdout, done.stderr
    assert times(place / "c") == before
    text = (place / "c/campaign.yaml").read_text()
    assert text.splitlines()[:2] == ['use: ["extensions/own.py", "extensions/law.py"]', "settings: quick"]
    environment = {**os.environ, "LABKIT_USE": str(place / "files/own.py")}  # the original as well as its copy
    words = [sys.executable, "-m", "labkit.plugins.campaigns.job", "statistics", "own"]
    again = subprocess.run(words, cwd=place / "c", env=environment, capture_output=True, text=True)
    assert again.returncode == 0, again.stderr


@pytest.mark.parametrize(
    "text",
    [
        "use: [a/own.py, b/own.py]\nname: c\n",
        "use:\n  - a/own.py\n  - b/own.py\nname: c\n",
        "name: c\n",
        "---\nname: c\n",
        "{name: c}\n",
        "{use: 'a/own.py', name: c}\n",
        "# first\n\nname: c\nuse:\n- a/own.py\n- b/own.py\n",
        "  name: c\n",
    ],
)
def test_the_copy_of_a_campaign_file_differs_only_in_use(text, tmp_path):
    import yaml

    names = copied_names([tmp_path / "a/own.py", tmp_path / "b/own.py"])
    assert names == ["extensions/own.py", "extensions/own-2.py"]
    assert yaml.safe_load(with_use(text, names)) == {"use": names, "name": "c"}
    assert with_use(text, []) == text
