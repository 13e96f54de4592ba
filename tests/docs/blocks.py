"""The blocks of code on a page, and a program that runs them here, given the page and a list of blocks.

A block is fenced, as Python or sh, or indented. Blocks of yaml are files; a sentence before them gives the name. A
comment in the page before a block, such as `<!-- not run: needs a cluster -->`, says why it is not run here.
"""

import ast
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from tests.docs.tutorial import execute

FENCED = r"^```(?P<language>\S+)[^\n]*\n(?P<fenced>.*?)^```$"
INDENTED = r"(?:(?<=\n\n)|(?<=->\n))(?P<indented>(?: {4}[^\n]*\n|\n(?= {4}))+)"
BLOCK = re.compile(rf"(?:<!-- not run: (?P<reason>[^\n]*) -->\n+)?(?:{FENCED}|{INDENTED})", re.MULTILINE | re.DOTALL)
# What the sentences of a page say that its reader has in Python; all other names are those of its own blocks.
READER = {
    "how_to.md": """
import labkit as lk, numpy as np, xarray as xr
state, run = lk.read_state("s.state.nc"), lk.Run.open("r.run.nc")
""",
    "paper_figures.md": 'import labkit as lk; run = lk.Run.open("r.run.nc")',
}


def blocks(page):
    """Pairs (language, code or reason): `python`, `sh`, `yaml NAME`, or `not run`."""
    text = "\n" + page.read_text()
    for found in BLOCK.finditer(text):
        language, code = found["language"], found["fenced"] or found["indented"]
        if found["reason"]:
            yield "not run", found["reason"]
        elif language in ("python", "{code-cell}"):
            yield "python", code
        elif language == "yaml":
            names = re.findall(r"[\w-]+\.yaml", text[: found.start()])
            yield f"yaml {names[-1] if names else 'any.yaml'}", code
        elif language == "sh" or language is None:
            code = re.sub(r"^ {4}", "", code, flags=re.MULTILINE)
            yield ("python" if is_python(code) else "sh"), code


def is_python(code):
    try:
        return bool(ast.parse(code).body)
    except SyntaxError:
        return False


def lay(code, fixtures):
    """Copy the files that a block reads, unless earlier blocks wrote them, or it writes them before."""
    for word in re.findall(r"""(?:-o |file=")?[^\s"'=,()]+""", code):
        if not word.startswith(("-o ", 'file="', "/", "..")):
            for file in fixtures.glob(word) if word.strip("*/") else ():
                target = file.relative_to(fixtures)
                written = re.search(rf"""(?:-o |file="){re.escape(str(target))}""", code)
                if not target.exists() and not (written and written.start() < code.find(word)):
                    target.parent.mkdir(parents=True, exist_ok=True)
                    (shutil.copytree if file.is_dir() else shutil.copy)(file, target)


def run(page, numbers, fixtures):
    """Run the blocks up to the last of these numbers; returns failures, number -> message."""
    names, failures = {"__name__": "__main__", "labkit_": None}, {}
    lay(READER.get(page.name, ""), fixtures)
    exec(READER.get(page.name, ""), names)
    for number, (language, code) in enumerate(blocks(page)):
        if number > max(numbers):
            break
        start = time.monotonic()
        print(f"== {page.name}, block {number}, {language}\n{code}", flush=True)
        try:
            if language.startswith("yaml"):
                Path(language.split()[1]).write_text(code)
            elif language != "not run":
                lay(code, fixtures)
            if language == "python":
                execute(code, names, f"{page.name}, block {number}")
            elif language == "sh":
                subprocess.run(["sh", "-ec", code], check=True)
        except BaseException as error:  # the other blocks run all the same
            failures[number] = f"{type(error).__name__}: {error}"
            print(failures[number])
        print(f"== {time.monotonic() - start:.1f} s", flush=True)
    return failures


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    failures = run(Path(sys.argv[1]), json.loads(sys.argv[2]), Path(sys.argv[3]))
    sys.exit("\n".join(f"block {number}: {text}" for number, text in failures.items()) or 0)
