"""The command that installs an extra names the checkout or the packages, never the bare name."""

import shlex
import subprocess
import sys

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


def test_without_a_checkout_the_packages_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    assert any(word.startswith("snakemake") for word in shlex.split(install_command("campaign")))
    *_, install, package = shlex.split(install_command("paraview"))
    assert install == "install" and package.startswith("h5py")
