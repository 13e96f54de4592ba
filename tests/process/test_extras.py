"""The command that installs an extra names the checkout or the packages, never the bare name."""

import shlex
import subprocess
import sys
from importlib import metadata

import pytest

from labkit.process import extras
from labkit.process.extras import install_command


def test_in_a_checkout_the_command_names_it():
    assert install_command("campaign") == shlex.join(
        [sys.executable, "-m", "pip", "install", f"{extras.ROOT}[campaign]"]
    )


@pytest.mark.slow
def test_pip_accepts_the_command():
    """A dry run without an index resolves every extra from the checkout and what is installed."""
    words = shlex.split(install_command("paraview"))
    options = ["--dry-run", "--no-index", "--no-build-isolation", "--no-deps", "--quiet"]
    done = subprocess.run([*words, *options], capture_output=True, text=True)
    assert done.returncode == 0 or "hatchling" in done.stderr, done.stderr


def test_without_a_checkout_the_packages_are_named():
    requires = metadata.distribution("labkit").requires
    assert any(one.startswith("snakemake") for one in extras._packages("campaign", requires))
    assert [one.partition(">")[0] for one in extras._packages("paraview", requires)] == ["h5py"]
