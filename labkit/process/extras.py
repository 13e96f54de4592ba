"""Optional dependencies of labkit, such as Snakemake or h5py, and the command that installs them."""

from __future__ import annotations

import importlib
import re
import shlex
import sys
import types
from importlib import metadata
from pathlib import Path

from labkit.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def require_library(name: str, what: str, extra: str) -> types.ModuleType:
    """Import an optional library. Raises InputError with the command that installs it.

    Args:
        name: Name of the module.
        what: Feature that needs the library, e.g. `ON-DEM files`.
        extra: Extra of labkit that lists the library.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(f"{what} need {name.split('.')[0]}: {install_command(extra)}") from None


def install_command(extra: str) -> str:
    """Return the pip command that installs an extra of labkit.

    `pip install labkit[extra]` would install whatever the public index lists under the name labkit. This command names
    the checkout from which labkit was installed or, failing that, the packages of the extra.
    """
    return f"{shlex.quote(sys.executable)} -m pip install {_requirement(extra)}"


def _requirement(extra: str) -> str:
    if (ROOT / "pyproject.toml").is_file():
        return shlex.quote(f"{ROOT}[{extra}]")
    try:
        installed = metadata.distribution("labkit")
    except metadata.PackageNotFoundError:
        return "the packages that pyproject.toml lists for it"
    return " ".join(shlex.quote(package) for package in _packages(extra, installed.requires or []))


def _packages(extra: str, requires: list[str]) -> list[str]:
    """Return the requirements of an extra, without environment markers."""
    of_extra = re.compile(rf"""extra\s*==\s*['"]{re.escape(extra)}['"]""")
    parts = [requirement.partition(";") for requirement in requires]
    return [name.strip() for name, _, marker in parts if of_extra.search(marker)]
