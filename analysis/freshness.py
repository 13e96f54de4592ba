"""`./lab results`: which commit wrote each file of results/, and whether code that it depends on has changed since."""

from __future__ import annotations

import argparse
import ast
import functools
import os
import subprocess
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import pandas

from analysis.manifest import MANIFEST, collect, provenance
from analysis.pictures import reduce_colours
from analysis.places import ROOT, read_yaml
from labkit.errors import InputError

RESULTS = ROOT / "results"
CODE = ("labkit", "analysis", "benchmarks")  # code that a file depends on if no study wrote it
NAMED = 3  # changed files
LEFT = "Rebuilt by `git checkout "  # on the page of a study whose code has left the tree


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab results`."""
    parser.add_argument(
        "part", nargs="*", help="only files, or studies, whose names contain one of these (default: all)"
    )
    tidy = "first put the provenance next to files into the manifests, and reduce the colours of the figures"
    parser.add_argument("--tidy", action="store_true", help=tidy)
    again = f"run again what takes less than an hour: {', '.join(short_commands())}"
    parser.add_argument("--again", action="store_true", help=again)


def main(options: argparse.Namespace, command: str) -> int:
    """Prints the table, if requested after the short commands; returns 1 if one failed or a file is out of date."""
    failed = []
    if options.again:
        os.chdir(ROOT)  # the commands expect their folders here
        folders = {words: words.split()[0].replace("-", "_") for words in short_commands()}
        chosen = [word for word, name in folders.items() if not options.part or any(p in name for p in options.part)]
        failed = [words for words in chosen if run_again(words)]
    if options.tidy:
        tidy()
    table = freshness(options.part)
    for row in table.itertuples():
        names = ", ".join(row.changed[:NAMED]) + ", ..." * (len(row.changed) > NAMED)
        state = f"{len(row.changed)} changed: {names}" if row.changed else "up to date"
        print(f"{row.file}: {row.commit[:9]}{' (stored)' * row.stored} {row.date}, {state}")
    stale = int(table["changed"].map(bool).sum())
    print(f"{len(table)} files, {stale} of them written by code that has changed since")
    if failed:
        print(f"failed: {'; '.join(failed)}")
    return int(stale > 0 or bool(failed))


def tidy() -> None:
    """Stores what labkit's own commands wrote into results/ as the studies store theirs."""
    for folder in {file.parent for file in RESULTS.rglob("*") if file.is_file()}:
        collect(folder)
    for file in RESULTS.rglob("*.png"):
        reduce_colours(file)


def short_commands() -> list[str]:
    """The commands that take less than an hour, from the stored data sets."""
    studies: dict[str, list[str]] = read_yaml(ROOT / "analysis" / "studies.yaml")
    return [f"{name} {options[0]}".strip() for name, (_, _, *options) in studies.items() if options]


def has_left(folder: str) -> bool:
    """True if the page in a folder of results/ names the commit that has the code of its study."""
    page = RESULTS / folder / "README.md"
    return page.is_file() and LEFT in page.read_text(encoding="utf-8")


def run_again(words: str) -> int:
    """Runs a study and says how long it took; returns its exit code, 1 if it crashed."""
    from analysis.__main__ import main

    start = time.monotonic()
    try:
        code = main(words.split())
    except Exception:
        traceback.print_exc()
        code = 1
    print(f"./lab {words}: exit code {code} after {time.monotonic() - start:.0f} s", flush=True)
    return code


def freshness(parts: list[str]) -> pandas.DataFrame:
    """The files of results/ whose names contain one of `parts` (all without any), a row each.

    Columns: file; commit; stored: True if only the commit that stored the file is known, not the one that wrote it;
    date of the commit; changed: the files of code that the file depends on and that have changed since. Comments and
    docstrings do not count. Studies whose code has left the tree are left out.
    """
    log = git("log", "--format=:%H %cs", "--name-only", "--", "results").splitlines()
    dates = dict(line[1:].split() for line in git("log", "--all", "--format=:%H %cs").splitlines())
    stored, commit = dict[str, str](), ""
    for line in filter(None, log):
        if line.startswith(":"):
            commit = line[1:].split()[0]
        else:
            stored.setdefault(line, commit)
    rows = []
    for file in git("ls-files", "results").splitlines():
        asked = not parts or any(part in file for part in parts)
        if Path(file).name == MANIFEST or not asked or has_left(Path(file).parts[1]):
            continue
        wrote = str((provenance(ROOT / file) or {}).get("commit", ""))
        known = wrote in dates
        commit = wrote if known else stored[file]
        changed = [name for name in dependencies(Path(file).parts[1]) if name in changes(commit)]
        rows.append({"file": file, "commit": commit, "stored": not known, "date": dates[commit], "changed": changed})
    return pandas.DataFrame(rows, columns=["file", "commit", "stored", "date", "changed"])


def git(*arguments: str) -> str:
    """Output of a git command in this clone. Raises InputError outside a clone."""
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"git {arguments[0]} failed ({done.stderr.strip()}): run ./lab results in a clone of labkit")
    return done.stdout


@functools.cache
def changes(commit: str) -> frozenset[str]:
    """The files of code that differ from a commit in more than comments and docstrings."""
    changed = set()
    for line in git("diff", "--raw", "--no-abbrev", "--no-renames", commit, "--", *CODE).splitlines():
        (_, _, blob, *_), name = line.split("\t")[0].split(), line.split("\t")[1]
        now = ROOT / name
        if not now.exists() or meaning(name, blob) != meaning(name, ""):
            changed.add(name)
    return frozenset(changed)


@functools.cache
def meaning(name: str, blob: str) -> str:
    """The syntax tree of a file of code, without comments and docstrings; `blob`: git's, "" for the present file."""
    text = git("cat-file", "blob", blob) if blob.strip("0") else "" if blob else (ROOT / name).read_text()
    if not name.endswith(".py"):
        return text
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return ast.dump(tree)


@functools.cache
def dependencies(folder: str) -> tuple[str, ...]:
    """Files of code that the results in a folder of results/ depend on: those of its study, and what they import.

    Without a study, all code.
    """
    home = ROOT / "analysis" / folder
    if not home.is_dir():
        return tuple(name for name in git("ls-files", *CODE).splitlines() if name.endswith((".py", ".yaml")))
    files, wanted = set[Path](), [file for file in home.rglob("*") if file.suffix in (".py", ".md", ".yaml", ".csv")]
    while wanted:
        file = wanted.pop()
        if file not in files:
            files.add(file)
            wanted += imported(file)
    return tuple(sorted(str(file.relative_to(ROOT)) for file in files))


def imported(file: Path) -> Iterator[Path]:
    """The files of CODE that a Python file imports, and those that it names in a text, as plug-ins are."""
    if file.suffix != ".py":
        return
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield from module_of(node.module or "", alias.name)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("lk", "labkit"):
            yield from module_of("labkit", node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("labkit."):
            yield from module_of(*node.value.partition(":")[::2])


def module_of(module: str, name: str) -> list[Path]:
    """The file that defines a name of a module; for a package this is not the one that lists its names."""
    place = ROOT / module.replace(".", "/")
    options = [place / f"{name}.py", place / name / "__init__.py", place.with_suffix(".py")] if name else []
    found = [option for option in options if option.is_file()][:1]
    listing = place / "__init__.py"
    if found or module.split(".")[0] not in CODE or not listing.is_file():
        return found if module.split(".")[0] in CODE else []
    for node in ast.walk(ast.parse(listing.read_text())):
        if isinstance(node, ast.ImportFrom) and any(name == (alias.asname or alias.name) for alias in node.names):
            return module_of(node.module or "", name)
    return [listing]
