"""A campaign folder from a stranger: nothing in it is executed, and no link in it leads to a file of the user."""

import os
import shutil
import subprocess
import sys

import pytest

from labkit.cli import main
from labkit.plugins.campaigns import workflow
from labkit.plugins.campaigns.file import read_campaign
from labkit.plugins.campaigns.job import run_job
from labkit.plugins.campaigns.layout import SNAKEMAKE
from labkit.plugins.campaigns.plan import write_plan
from tests.conftest import PATIENCE

pytest.importorskip("snakemake", reason="needs Snakemake, the extra `campaign`")

CAMPAIGN = """\
settings: quick
snapshots: 2
engine: fused
specimens: {a: {void_ratio: 0.7, grains: 100}}
runs: {cv: {path: cv, specimen: a, strain: 0.002}}
"""
HIT = "import os; open(os.environ['HITS'], 'a').write(__file__ + '\\n')\n"
PLUGIN = "snakemake_logger_plugin_stranger/__init__.py"  # Snakemake imports all plugins that it finds
PROFILE = "profiles/default/config.yaml"
NUMBA = ".numba_config.yaml"
IMPORTED = ("sys", "builtins", "__main__", "__future__", "_frozen_importlib")  # before a folder can matter


def strangers_folder(folder):
    """Modules with the names of all others, plugins and settings; each leaves a hit if it is executed."""
    installed = {"labkit", "numpy", "yaml", "snakemake", "numba", "matplotlib", "conftest", "usercustomize", "netCDF4"}
    for name in (sys.stdlib_module_names | installed | {"sitecustomize"}) - set(IMPORTED):
        (folder / f"{name}.py").write_text(HIT)
    for name in ("labkit", f".snakemake/pip-deployments/{os.path.dirname(PLUGIN)}"):
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text(HIT)
    (folder / PROFILE).parent.mkdir(parents=True)
    (folder / PROFILE).write_text("default-resources: [\"hit=__import__('os').system('echo x >> $HITS') or 1\"]\n")
    (folder / "slurm").mkdir()
    (folder / "slurm/config.yaml").write_text((folder / PROFILE).read_text())
    return folder


@pytest.fixture
def hits(tmp_path, monkeypatch):
    """Function that returns what was executed."""
    monkeypatch.setenv("HITS", str(tmp_path / "hits"))
    return lambda: (tmp_path / "hits").read_text() if (tmp_path / "hits").exists() else ""


def labkit_there(folder, *words):
    """`labkit words` in a folder, with a PYTHONPATH that ends in nothing, and a profile for Snakemake."""
    places = os.pathsep.join([*map(os.path.abspath, sys.path), ""])
    environment = {**os.environ, "PYTHONPATH": places, "SNAKEMAKE_PROFILE": "slurm"}
    program = [sys.executable, "-P", "-m", "labkit.cli"]
    done = subprocess.run(
        [*program, *map(str, words)], cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_nothing_in_the_folder_of_a_campaign_is_executed(tmp_path, hits, engine):
    folder = tmp_path / "c"
    folder.mkdir()
    strangers_folder(folder)
    (tmp_path / "c.yaml").write_text(CAMPAIGN.replace("fused", engine))
    done = labkit_there(tmp_path, "campaign", "c.yaml", "--cores", 1)
    assert not hits(), hits()
    assert done.returncode == 0 and (folder / "runs/cv.run.nc").exists(), done.stdout + done.stderr


@pytest.mark.parametrize("name", [NUMBA, "matplotlibrc", "ucx.conf"])
def test_settings_of_libraries_in_the_folder_are_refused(name, tmp_path, capsys):
    """Numba and MPI would load code from folders that they name."""
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / name).write_text("cache_dir: here\n")
    (tmp_path / "c.yaml").write_text(CAMPAIGN)
    assert main(["campaign", str(tmp_path / "c.yaml"), "--folder", str(tmp_path / "c")]) == 2
    assert f"c/{name} would change what the jobs do" in capsys.readouterr().err


LINKS = (
    "recipes/run.cv.json recipes/specimen.a.json campaign.yaml logs/snakemake.log logs/run.cv.log "
    "specimens/a.state.nc unfinished/cv.0123456789ab.run.nc runs/cv.run.nc statistics/cv.nc figures/cv.png plan.json "
    "report.md report.md.provenance.json overview.png recipes logs unfinished outdated extensions .snakemake"
).split()


@pytest.mark.parametrize("name", LINKS)
def test_a_link_among_the_files_of_a_campaign_is_refused(name, tmp_path, capsys):
    """The folder has recipes of the same campaign, so that its other files are not strange."""
    folder, victim = tmp_path / "c", tmp_path / "victim"
    (tmp_path / "c.yaml").write_text(CAMPAIGN)
    write_plan(read_campaign(tmp_path / "c.yaml"), folder)
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    file = folder / name
    if file.is_dir():
        shutil.rmtree(file)
    file.unlink(missing_ok=True)
    victim.write_text("precious") if file.suffix else victim.mkdir()
    file.symlink_to(victim)
    before = sorted(folder.rglob("*"))
    assert main(["campaign", str(tmp_path / "c.yaml"), "--folder", str(folder)]) == 2
    assert f"{file} is a link" in capsys.readouterr().err
    assert victim.read_text() == "precious" if file.suffix else not list(victim.iterdir())
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("kind", ["symbolic", "hard"])
def test_the_log_of_a_job_is_a_new_file(kind, tmp_path, monkeypatch):
    """Whatever came there after the campaign had begun."""
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN)
    write_plan(read_campaign(tmp_path / "campaign.yaml"), tmp_path)
    log = tmp_path / "logs/run.cv.log"
    log.symlink_to(victim) if kind == "symbolic" else log.hardlink_to(victim)
    monkeypatch.chdir(tmp_path)
    assert run_job("run", "cv") == 2  # its specimen is missing
    assert victim.read_text() == "precious"
    assert log.is_symlink() or "specimens/a.state.nc" in log.read_text()


def test_snakemake_reads_nothing_that_a_stranger_left_for_it(tmp_path, hits):
    """Its notes may contain pickles, and packages with plugins, which it would import."""
    plugin = tmp_path / ".snakemake/pip-deployments" / PLUGIN
    plugin.parent.mkdir(parents=True)
    plugin.write_text(HIT)
    log = tmp_path / ".snakemake/log/earlier.log"
    log.parent.mkdir()
    log.write_text("kept")
    workflow.forget(tmp_path / SNAKEMAKE)
    assert list(tmp_path.rglob("*.*")) == [tmp_path / ".snakemake", log]


def test_a_default_folder_that_is_a_link_is_refused(tmp_path, monkeypatch, capsys):
    """The user has not typed it."""
    (tmp_path / "c.yaml").write_text(CAMPAIGN)
    (tmp_path / "theirs").mkdir()
    (tmp_path / "c").symlink_to("theirs")
    monkeypatch.chdir(tmp_path)
    assert main(["campaign", "c.yaml"]) == 2
    assert "c is a link" in capsys.readouterr().err and not list((tmp_path / "theirs").iterdir())
