"""User-supplied Python files of a campaign (`use:`): their copies in the campaign folder.

The folder contains everything that the campaign needs: its copy of the campaign file names the copies in `extensions/`.
Editing the original files while jobs run has no effect, and the folder can be moved. A file must not depend on other
files in its folder.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from labkit.campaigns.document import read_text
from labkit.campaigns.file import USE, read_campaign
from labkit.campaigns.items import Campaign
from labkit.extensions import VARIABLE
from labkit.io.atomic import write_text

FOLDER = "extensions"
CAMPAIGN = "campaign.yaml"  # copy of the campaign file


def copied_names(files: Sequence[Path]) -> list[str]:
    """Names of the copies, relative to the campaign folder: the original names, made unique where necessary."""
    names: list[str] = []
    for file in files:
        tries = (f"{FOLDER}/{file.stem}{f'-{k}' * (k > 1)}{file.suffix}" for k in range(1, len(files) + 1))
        names.append(next(name for name in tries if name not in names))
    return names


def copy_campaign(campaign: Campaign, text: str, folder: Path) -> None:
    """Write the campaign file with this text and the files that it uses to the folder, unless they are up to date."""
    if campaign.use:
        (folder / FOLDER).mkdir(exist_ok=True)
    for name, content in to_write(campaign, text, folder).items():
        write_text(folder / name, content)


def to_write(campaign: Campaign, text: str, folder: Path) -> dict[str, str]:
    """Return copies that are missing in the folder or not up to date, name -> content."""
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


def read_copy(folder: str | os.PathLike[str] = ".") -> Campaign:
    """Read the Campaign of a folder only from the copies stored there, ignoring LABKIT_USE.

    Jobs that run in separate processes use this function.
    """
    os.environ[VARIABLE] = ""
    return read_campaign(Path(folder) / CAMPAIGN)
