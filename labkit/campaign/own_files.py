"""The user's own Python files of a campaign (`use:`): their hashes, and their copies in the folder of the campaign.

The folder has all that the campaign needs: its copy of the campaign file names the copies in `extensions/`. So a file
that is edited while jobs run changes none of them, and the folder can be moved. A file must not need others beside it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from labkit.campaign.document import Mistakes, compose, read_text
from labkit.campaign.file import USE, read_campaign
from labkit.campaign.items import Campaign
from labkit.extensions import VARIABLE
from labkit.io.files import write_text

FOLDER = "extensions"
CAMPAIGN = "campaign.yaml"  # a copy of the file


def copied_names(files: Sequence[Path]) -> list[str]:
    """Names of the copies, relative to the folder of the campaign: those of the files, told apart where need be."""
    names: list[str] = []
    for file in files:
        tries = (f"{FOLDER}/{file.stem}{f'-{k}' * (k > 1)}{file.suffix}" for k in range(1, len(files) + 1))
        names.append(next(name for name in tries if name not in names))
    return names


def copy_campaign(campaign: Campaign, text: str, folder: Path) -> None:
    """Puts the campaign file of that text and the files that it uses into the folder, where they are not there yet."""
    names = copied_names(campaign.use)
    texts = dict(zip(names, map(read_text, campaign.use), strict=True))
    if campaign.use:
        (folder / FOLDER).mkdir(exist_ok=True)
    for name, content in {**texts, CAMPAIGN: with_use(text, names)}.items():
        if not (folder / name).exists() or read_text(folder / name) != content:
            write_text(folder / name, content)


def with_use(text: str, names: Sequence[str]) -> str:
    """The text of a campaign file with `use:` of these files, in place of what it says; nothing else is changed."""
    root = compose(text, Mistakes())
    if root is None or not names:
        return text
    use = f"{USE}: {json.dumps(list(names))}"
    for key, value in root.value:
        if key.value == USE:
            ending = "\n" * (value.id == "sequence" and not value.flow_style)  # it ends where the next key begins
            return f"{text[: key.start_mark.index]}{use}{ending}{text[value.end_mark.index :]}"
    begin = root.start_mark.index
    if root.flow_style:
        return f"{text[: begin + 1]}{use}, {text[begin + 1 :]}"
    return f"{text[:begin]}{use}\n{' ' * root.start_mark.column}{text[begin:]}"


def read_copy(folder: str | os.PathLike[str] = ".") -> Campaign:
    """The Campaign of a folder from the copies there alone, whatever LABKIT_USE says; for processes of their own."""
    os.environ[VARIABLE] = ""
    return read_campaign(Path(folder) / CAMPAIGN)
