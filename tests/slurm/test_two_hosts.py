"""Ranks on two hosts, and on two nodes of SLURM, have the bits of one thread. The hosts are network namespaces."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.ranks import differences
from labkit.engines import mpi
from tests.conftest import PATIENCE
from tests.engines.test_ranks import small_domains, specimen  # noqa: F401

pytestmark = [pytest.mark.long, pytest.mark.mpi]

SCRIPT = Path(__file__).with_name("two_hosts.sh")
LAUNCH = "-launcher ssh -launcher-exec {folder}/ssh -hosts nodeb -ppn 2"  # rank 0 is on nodea
SRUN = "srun --mpi=pmi2 --overlap --kill-on-bad-exit -N2"


@pytest.fixture(scope="module")
def hosts(tmp_path_factory):
    """A folder with a program `ssh`, for the duration of the tests."""
    if os.geteuid() != 0 or not shutil.which("ip") or not shutil.which("unshare"):
        pytest.skip("needs root and iproute2")
    folder = tmp_path_factory.mktemp("hosts")
    (folder / "ssh").write_text(f'#!/bin/sh\nexec {SCRIPT} on "$@"\n')
    (folder / "ssh").chmod(0o755)
    try:
        started = subprocess.run([SCRIPT, "start"], capture_output=True, text=True)
        if started.returncode:
            pytest.skip(f"network namespaces are not allowed here: {started.stderr.strip()}")
        yield folder
    finally:
        subprocess.run([SCRIPT, "stop", folder], capture_output=True)


def shear(output, *more):
    words = ("run", "cv", "s.state.nc", "--strain", 0.0003, "--rate", 25, "--record-strain", 0.0001, "-o", output)
    return [*map(str, (sys.executable, "-m", "labkit.cli", *words, *more))]


def on_nodea(words, **options):
    return subprocess.run([SCRIPT, "on", "nodea", *words], capture_output=True, text=True, timeout=PATIENCE, **options)


def require_same_bits(folder, launcher, environment, *before):
    """Run on one thread here, and on three ranks that a launcher starts; the files may not differ."""
    one = subprocess.run(shear("one.run.nc"), cwd=folder, env=environment, capture_output=True, text=True)
    assert one.returncode == 0, one.stderr
    there = {**environment, "UCX_TLS": "tcp,self", mpi.LAUNCHER: launcher}
    done = on_nodea([*before, *shear("hosts.run.nc", "--ranks", 3)], cwd=folder, env=there)
    assert done.returncode == 0, done.stderr
    count, odd = differences(folder / "one.run.nc", folder / "hosts.run.nc")
    assert odd == [] and count > 40


def test_two_hosts(hosts, specimen, small_domains):  # noqa: F811
    hydra = shutil.which("mpiexec.hydra", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    if not hydra:
        pytest.skip("needs the launcher hydra of MPICH")
    require_same_bits(specimen.parent, f"{hydra} {LAUNCH.format(folder=hosts)}", small_domains)


def test_two_nodes_of_slurm(hosts, specimen, small_domains, tmp_path_factory):  # noqa: F811
    missing = [name for name in ("slurmctld", "slurmd", "munged", "salloc") if not shutil.which(name)]
    if missing:
        pytest.skip(f"needs SLURM: apt-get install slurm-wlm munge ({missing[0]} is missing)")
    environment = {**small_domains, "SLURM_CONF": str(hosts / "slurm.conf")}
    started = subprocess.run([SCRIPT, "slurm", hosts], capture_output=True, text=True, env=environment)
    assert started.returncode == 0, started.stderr
    require_same_bits(specimen.parent, SRUN, environment, "salloc", "-N2")
