"""The command that installs an extra of labkit (Snakemake, meshio, ...) from where labkit itself was installed."""

from __future__ import annotations

import json
import re
import shlex
import sys
from importlib import metadata
from pathlib import Path
from urllib.parse import unquote, urlparse

ROOT = Path(__file__).resolve().parents[2]


def install_command(extra: str) -> str:
    """The pip command that installs an extra.

    A bare `labkit[extra]` would fetch whatever package the public index has under that name; this command names the
    checkout, or the file that labkit was installed from, or else the packages of the extra themselves.
    """
    return f"{shlex.quote(sys.executable)} -m pip install {_requirement(extra)}"


def _requirement(extra: str) -> str:
    if (ROOT / "pyproject.toml").is_file():
        return shlex.quote(f"{ROOT}[{extra}]")
    try:
        installed = metadata.distribution("labkit")
    except metadata.PackageNotFoundError:
        return "the packages that pyproject.toml lists for it"
    source = _source(installed.read_text("direct_url.json"))
    if source is not None:
        return shlex.quote(f"{source}[{extra}]")
    return " ".join(shlex.quote(one) for one in _packages(extra, installed.requires or []))


def _source(text: str | None) -> str | None:
    """Local path in a direct_url.json, the file in which pip notes where a package came from; None for another."""
    url = urlparse(json.loads(text)["url"]) if text else None
    if url is None or url.scheme != "file":
        return None
    path = unquote(url.path)
    return path if Path(path).exists() else None


def _packages(extra: str, requires: list[str]) -> list[str]:
    """Requirements of an extra, without their markers."""
    of_extra = re.compile(rf"""extra\s*==\s*['"]{re.escape(extra)}['"]""")
    parts = [one.partition(";") for one in requires]
    return [name.strip() for name, _, marker in parts if of_extra.search(marker)]
