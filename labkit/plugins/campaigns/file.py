"""Reads a campaign file: YAML edited by hand, parsed into jobs; every error is reported with its line.

    use: own_path.py                    # user-defined paths, laws, statistics, engines: see labkit.extensions
    settings: quick                     # quick, standard or reference; the default for all entries
    engine: fused
    specimens:
      dense: {void_ratio: 0.606, step1_friction: 0.0405, grains: 500, seed: [1, 2]}
      dense_1MPa: {from: dense, pressure: 1 MPa}         # the same specimen, consolidated
    runs:
      cp: {path: cp, specimen: dense, pressure: [0.5 MPa, 1 MPa], engine: [yade, fused]}

Lists are expanded: `cp` stands for eight runs, cp-dense-s1-p500kPa-yade and so on; every key but `path` and `from` may
be a list. Keys are the parameters of Recipe, Scene, Options and the path (labkit.parameters). Values have a unit or
are in SI units, as on the command line.

The campaign folder contains everything that the campaign needs: its copy of the campaign file names copies of the files
under `use`, in `extensions/`. Editing the original files while jobs run has no effect, and the folder can be moved. A
user-supplied file must not depend on other files in its folder.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path

from labkit import extensions
from labkit.errors import InputError
from labkit.extensions import VARIABLE
from labkit.files.atomic import write_text
from labkit.files.hashes import file_sha256
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.campaigns.keys import file_keys
from labkit.plugins.campaigns.layout import CAMPAIGN, EXTENSIONS
from labkit.plugins.campaigns.runs import read_runs
from labkit.plugins.campaigns.specimens import Planner, read_specimens
from labkit.text.document import Block, Entry, Errors, Node, Rows, compose, kind_of, read_fields, read_text, scalar

BUILT_IN = ("quick",)  # campaigns that come with labkit
USE, SECTIONS = "use", ("specimens", "runs")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,59}")


@dataclasses.dataclass(frozen=True)
class Campaign:
    """The jobs that a campaign file describes, each after its source; `use` lists the user's files that it needs."""

    name: str
    jobs: tuple[Job, ...]
    use: tuple[Path, ...] = ()

    @property
    def specimens(self) -> list[Job]:
        """Specimens to make."""
        return [job for job in self.jobs if job.kind == "specimen"]

    @property
    def consolidations(self) -> list[Job]:
        """Specimens to consolidate, including consolidations that labkit inserts before runs."""
        return [job for job in self.jobs if job.kind == "consolidation"]

    @property
    def runs(self) -> list[Job]:
        """Runs to carry out."""
        return [job for job in self.jobs if job.kind == "run"]

    @property
    def engines(self) -> list[str]:
        """Names of the engines that the jobs need."""
        return sorted({job.device.name for job in self.jobs})


def campaign_file(name: str) -> Path:
    """Return the path of a campaign file: the file itself, or a campaign that comes with labkit."""
    return Path(__file__).with_name(f"{name}.yaml") if name in BUILT_IN else Path(name)


def read_campaign(file: str | os.PathLike[str]) -> Campaign:
    """Read a campaign file and load the files that it uses. Raises InputError with every error and its line."""
    file = Path(file)
    errors = Errors(file.parent)
    root = compose(read_text(file), errors)
    if root is None or not _use(root, file.parent, errors):  # without these files, the rest cannot be checked
        raise InputError(errors.report(file))
    campaign = _campaign(root, file.stem, errors)
    if errors.count:
        raise InputError(errors.report(file))
    return campaign


def _use(root: Block, folder: Path, errors: Errors) -> bool:
    """Load the files under `use`, with paths relative to the campaign file; returns True if all could be loaded."""
    before = errors.count
    for node in _used(root):
        name = scalar(node, f"the file: {USE}", errors)
        try:
            if name is not None:
                extensions.use(folder / name)
        except InputError as error:
            errors.add(node.line, f"the file: {error.message()}")
    return errors.count == before


def _campaign(root: Block, stem: str, errors: Errors) -> Campaign:
    top = read_fields(root, file_keys(), "the file", errors, sections=(USE, *SECTIONS), line=1)
    name = top.values.pop("name", stem)
    if not NAME.fullmatch(name):
        top.error(f"the name {name!r} cannot be the name of a folder: use letters, digits, _ . -", "name")
    specimen_entries, run_entries = (_section(root, section, errors) for section in SECTIONS)
    used = tuple(map(Path, extensions.files_in_use()))
    planner = Planner(top.values, tuple(copied_names(used)), tuple(map(file_sha256, used)))
    specimens = read_specimens(specimen_entries, planner, errors)
    return Campaign(name, (*specimens, *read_runs(run_entries, planner, errors)), used)


def _section(root: Block, section: str, errors: Errors) -> list[Entry]:
    """Return name, line and content of each entry of a section; a name that cannot be a file name is an error."""
    if section not in root:
        errors.add(1, f"`{section}:` is missing: add it, see docs/campaigns.md")
        return []
    node = root[section]
    if not node:
        errors.add(node.line, f"`{section}:` is empty: add an entry")
        return []
    if not isinstance(node, Block):
        errors.add(node.line, f"`{section}:` is {kind_of(node)}: write names and values, `key: value`")
        return []
    for name in node:
        if not NAME.fullmatch(name):
            problem = f"the name {name!r} cannot be the name of a file: use up to 60 letters, digits, _ . -"
            errors.add(node.lines[name], problem)
    return [Entry(name, node.lines[name], content) for name, content in node.items() if NAME.fullmatch(name)]


# --- copies in the campaign folder ------------------------------------------------------------------------------------


def copied_names(files: Sequence[Path]) -> list[str]:
    """Return the names of the copies, relative to the campaign folder: original names, made unique if necessary."""
    names: list[str] = []
    for file in files:
        tries = (f"{EXTENSIONS}/{file.stem}{f'-{k}' * (k > 1)}{file.suffix}" for k in range(1, len(files) + 1))
        names.append(next(name for name in tries if name.lower() not in map(str.lower, names)))
    return names


def copy_campaign(campaign: Campaign, text: str, folder: Path) -> None:
    """Write the campaign file with this text and the files that it uses to the folder, unless they are up to date."""
    if campaign.use:
        (folder / EXTENSIONS).mkdir(exist_ok=True)
    for name, content in to_write(campaign, text, folder).items():
        write_text(folder / name, content)


def to_write(campaign: Campaign, text: str, folder: Path) -> dict[str, str]:
    """Return the copies that are missing from the folder or out of date, name -> content."""
    names = copied_names(campaign.use)
    copies = dict(zip(names, map(read_text, campaign.use), strict=True)) | {CAMPAIGN: with_use(text, names)}
    missing = (name for name in copies if not (folder / name).exists() or read_text(folder / name) != copies[name])
    return {name: copies[name] for name in missing}


def with_use(text: str, names: Sequence[str]) -> str:
    """Return the text of a campaign file with its `use:` replaced by these files; nothing else is changed."""
    import yaml

    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if root is None or not names:
        return text
    use = f"{USE}: {json.dumps(list(names))}"
    for key, value in root.value:
        if key.value == USE:
            ending = "\n" * (
                isinstance(value, yaml.SequenceNode) and not value.flow_style
            )  # a block list ends where the next key begins
            return f"{text[: key.start_mark.index]}{use}{ending}{text[value.end_mark.index :]}"
    begin = root.start_mark.index
    if text[begin] == "{":
        return f"{text[: begin + 1]}{use}, {text[begin + 1 :]}"
    return f"{text[:begin]}{use}\n{' ' * root.start_mark.column}{text[begin:]}"


def _used(root: Block) -> list[Node]:
    """Return the nodes under `use`."""
    node = root.get(USE, Rows())
    return node if isinstance(node, Rows) else [node]


def named_files() -> set[str]:
    """Return the files under `use` in the campaign file of the current folder."""
    root = compose(read_text(Path(CAMPAIGN)), Errors(Path()))
    return {name for name in _used(root or Block()) if isinstance(name, str)}


def read_copy() -> Campaign:
    """Read the Campaign of the current folder, only from the copies stored there, ignoring LABKIT_USE."""
    os.environ[VARIABLE] = ""
    return read_campaign(CAMPAIGN)
