"""The campaign file: YAML that a person edits, read as values, with every mistake in it and its line.

    use: own_path.py                    # own paths, laws, statistics, engines: see labkit.extensions
    settings: quick                     # quick, standard, reference; for what says nothing else
    engine: fused
    specimens:
      dense: {void_ratio: 0.606, step1_friction: 0.0405, grains: 500, seed: [1, 2]}
      dense_1MPa: {from: dense, pressure: 1 MPa}         # the same, consolidated
    runs:
      cp: {path: cp, specimen: dense, pressure: [0.5 MPa, 1 MPa], engine: [yade, fused]}

Lists multiply: `cp` is eight runs, cp-dense-s1-p500kPa-yade and so on. Keys are the parameters of Recipe, Scene,
Options and the path (labkit.parameters); quantities have units.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from labkit import extensions
from labkit.campaign.document import Entry, Mistakes, compose, entries, line_of, read_fields, read_text, scalar
from labkit.campaign.items import Campaign
from labkit.campaign.keys import file_keys
from labkit.campaign.runs import check_run, read_runs
from labkit.campaign.specimens import read_specimens
from labkit.errors import InputError

if TYPE_CHECKING:
    from yaml.nodes import Node

OURS = ("quick",)  # campaigns that come with labkit
USE, SECTIONS = "use", ("specimens", "runs")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,59}")


def campaign_file(name: str) -> Path:
    """The file of that name, or that of a campaign that comes with labkit."""
    return Path(__file__).with_name(f"{name}.yaml") if name in OURS else Path(name)


def read_campaign(file: str | os.PathLike[str]) -> Campaign:
    """The Campaign in a file; loads the files that it uses. Raises InputError with every mistake and its line."""
    file = Path(file)
    mistakes = Mistakes()
    root = compose(read_text(file), mistakes)
    if root is not None:
        _use(root, file.parent, mistakes)
    if mistakes.count:  # without its own files nothing more can be said of it
        raise InputError(mistakes.report(file))
    campaign = _campaign(root, file.stem, mistakes)
    if mistakes.count:
        raise InputError(mistakes.report(file))
    return campaign


def _use(root: Node, folder: Path, mistakes: Mistakes) -> None:
    """Loads the files of `use`, which are relative to the campaign file."""
    node = next((entry.value for entry in entries(root, "the file", Mistakes()) if entry.name == USE), None)
    if node is None:
        return
    for one in node.value if node.id == "sequence" else [node]:
        name = scalar(one, f"the file: {USE}", mistakes)
        try:
            if name is not None:
                extensions.use(folder / name)
        except InputError as error:
            mistakes.add(line_of(one), f"the file: {error.said()}")


def _campaign(root: Node, stem: str, mistakes: Mistakes) -> Campaign:
    top = read_fields(root, file_keys(), "the file", mistakes, sections=(USE, *SECTIONS), line=1)
    name = top.values.pop("name", stem)
    if not NAME.fullmatch(name):
        top.mistake(f"the name {name!r} makes no name of a folder: use letters, digits, _ . -", "name")
    nodes = {entry.name: entry.value for entry in entries(root, "the file", Mistakes())}
    for section in SECTIONS:
        if section not in nodes:
            mistakes.add(1, f"`{section}:` is missing: add it, see README.md")
    specimens, runs = (_named(nodes.get(section), section, mistakes) for section in SECTIONS)
    made = read_specimens(specimens, top.values, mistakes)
    found = read_runs(runs, top.values, made, mistakes)
    used = tuple(map(Path, extensions.used()))
    campaign = Campaign(name, made.made, made.consolidated, tuple(run for run, _ in found), used)
    for run, fields in found:
        check_run(campaign, run, fields)
    return campaign


def _named(node: Node | None, section: str, mistakes: Mistakes) -> list[Entry]:
    """The entries of a section, with names that may be names of files."""
    if node is None:
        return []
    if not node.value:
        mistakes.add(line_of(node), f"`{section}:` is empty: add one")
        return []
    found = entries(node, f"`{section}:`", mistakes)
    for name, line, _ in found:
        if not NAME.fullmatch(name):
            said = f"the name {name!r} makes no name of a file: use up to 60 letters, digits, _ . -"
            mistakes.add(line, said)
    return [entry for entry in found if NAME.fullmatch(entry.name)]
