"""How fast is the page of `labkit page` in Chromium, beside labkit on the same computer?

    python -m benchmarks.page --pyodide FOLDER --grains 500 2000 --rounds 3 --exercises --folder results/page

Chromium and this computer make the same specimen and shear it at constant p to 10 %, in turn (speed.csv). `wall` counts
seconds of the clock, `cpu` those in which the thread that computes had a core, which other jobs change less, and
`memory` is the most (MB) that the page took. visit.csv lists the files that a first visit loads, differences.csv the
largest differences between two runs that begin with the same State, exercises.csv the numbers of all exercises.
"""

from __future__ import annotations

import argparse
import asyncio
import functools
import gzip
import itertools
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

import labkit as lk
from labkit.engines.base import silent
from labkit.files.provenance import write_with_provenance
from labkit.plugins.page.bench import OPTIONS, Bench
from labkit.plugins.page.form import Choices
from labkit.plugins.page.server import Handler
from labkit.plugins.page.site import EXERCISES, wheel_for_browsers, write_site

if TYPE_CHECKING:
    from playwright.sync_api import Page

RECIPE = {"void_ratio": "0.62"}
PATH = lk.paths.ConstantMeanStress(strain=0.1)
BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
OPTIONS_OF_BROWSER = ("--no-sandbox", "--disable-3d-apis")  # without the picture in 3D, which a graphics card draws
PATIENCE = 3_600_000  # ms
COLUMNS = ["round", "grains", "where", "stage", "wall", "cpu", "memory"]
TICKS = os.sysconf("SC_CLK_TCK")


def choices(grains: int) -> dict[str, dict[str, str]]:
    """Return what somebody types for the test of so many grains."""
    return {"recipe": {**RECIPE, "grains": str(grains)}, "path": {"name": "cp", "strain": "0.1"}}


def here(grains: int) -> list[float]:
    """Return wall and processor time, in s, at which the specimen is made and the test is over, in this process."""
    marks: list[float] = []

    def listen(text: str) -> None:
        message = json.loads(text)
        if "panels" in message or "finished" in message:
            marks.extend((time.perf_counter(), time.thread_time()))

    marks.extend((time.perf_counter(), time.thread_time()))
    asyncio.run(Bench(listen).start(choices(grains)))
    return marks


def workers(browser: int) -> tuple[float, float]:
    """Return processor time (s) and memory (MB) of the pages that compute, in the processes below that of a browser.

    The time is that of the thread in which Python runs, the memory the most that the whole page took.
    """
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it ended
            continue
    inside = {browser}
    while more := {child for child, parent in parents.items() if parent in inside} - inside:
        inside |= more
    seconds = memory = 0.0
    for process in inside:
        for stat in Path(f"/proc/{process}/task").glob("*/stat"):
            name, _, fields = stat.read_text().partition("(")[2].rpartition(")")
            if name.startswith("DedicatedWorker"):
                seconds += sum(map(int, fields.split()[11:13])) / TICKS
                status = Path(f"/proc/{process}/status").read_text()
                memory = max(memory, int(status.partition("VmHWM:")[2].split()[0]) / 1e3)
    return seconds, memory


def in_page(page: Page, address: str, grains: int) -> dict[str, tuple[float, float]]:
    """Return the wall and processor times (s) until the page is ready, of the specimen, and of the test."""
    marks = [(time.perf_counter(), 0.0)]

    def mark(selector: str) -> None:
        page.wait_for_selector(f"{selector}, #error:not([hidden])", state="attached")
        if page.is_visible("#error"):
            raise SystemExit(page.inner_text("#error"))
        marks.append((time.perf_counter(), workers(os.getpid())[0]))

    page.goto(address)
    mark("#status[data-ready]")
    page.evaluate("(texts) => preset(texts)", choices(grains))
    marks[-1] = (time.perf_counter(), marks[-1][1])
    ready = marks[1][0] - marks[0][0], marks[1][1]
    page.click("#run")
    mark("article.plot")
    mark("#status[data-runs='1']")
    stages = zip(("specimen", "test"), marks[1:], marks[2:], strict=False)
    return {"ready": ready, **{name: (b[0] - a[0], b[1] - a[1]) for name, a, b in stages}}


def on_desktop(grains: int) -> dict[str, tuple[float, float]]:
    """Return the same of a new process on this computer."""
    begin = time.perf_counter()
    words = [sys.executable, "-m", "benchmarks.page", "--here", str(grains)]
    out = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    ready, cpu, marks = json.loads(out.splitlines()[-1])
    a, b, c = ((marks[k], marks[k + 1]) for k in (0, 2, 4))
    return {"ready": (ready - begin, cpu), "specimen": (b[0] - a[0], b[1] - a[1]), "test": (c[0] - b[0], c[1] - b[1])}


def visit(folder: Path, names: set[str]) -> pd.DataFrame:
    """Return the sizes (bytes) of the files that were loaded, as they are and as a web server compresses them."""
    files = [(name, (folder / name).read_bytes()) for name in sorted(names) if (folder / name).is_file()]
    rows = [(name, len(content), min(len(content), len(gzip.compress(content, 6)))) for name, content in files]
    return pd.DataFrame(rows, columns=["file", "bytes", "gzipped"])


def differences(page: Page, grains: int, scratch: Path) -> pd.DataFrame:
    """Return the largest differences of three quantities between a run in the page and the same one here."""
    state = Choices.of(choices(grains)).specimen(silent)
    lk.write_state(scratch / "s.state.npz", state)
    page.set_input_files("#state", scratch / "s.state.npz")
    page.wait_for_function("/^State/.test(document.getElementById('status').textContent)")
    page.evaluate("(texts) => preset(texts)", choices(grains))
    runs = int(page.get_attribute("#status", "data-runs") or 0)
    page.click("#go_on")
    page.wait_for_selector(f"#status[data-runs='{runs + 1}']", state="attached")
    with page.expect_download() as download:
        page.click("#run_file")
    download.value.save_as(scratch / "page.run.npz")
    there = lk.open_run(scratch / "page.run.npz")
    here = lk.run(state, PATH, save_every=OPTIONS.save_every, snapshots=OPTIONS.snapshots, progress=False).data
    names = ("q/p", "void_ratio", "coordination_number")
    values = [(here.lab.quantity(name).values, there.lab.quantity(name).values) for name in names]
    rows = [
        (grains, name, np.abs(a - b)[:11].max(), np.abs(a - b).max())
        for name, (a, b) in zip(names, values, strict=True)
    ]
    return pd.DataFrame(rows, columns=["grains", "quantity", "to_1_percent", "to_10_percent"])


def exercises(page: Page, address: str) -> Iterator[tuple[str, str, str, float, float]]:
    """Yield exercise, test, number, and its values on a computer (as stored) and in the page, for all exercises."""
    for exercise in json.loads(EXERCISES.read_text()):
        for number, test in enumerate(exercise["tests"]):
            page.goto(f"{address}?exercise={exercise['name']}&test={number}")
            page.wait_for_selector("#status[data-ready]", state="attached")
            page.click("#run")
            page.wait_for_selector("#status[data-runs='1']", state="attached")
            for row in page.query_selector_all("#exercise tr")[1:]:
                words, there, here = (cell.text_content() or "" for cell in row.query_selector_all("td"))
                print(exercise["name"], test["title"], words, there, here, flush=True)
                yield exercise["name"], test["title"], words, float(there), float(here)


def store(tables: dict[str, pd.DataFrame], folder: str) -> None:
    """Write the tables that are there so far."""
    command = shlex.join(["python", "-m", "benchmarks.page", *sys.argv[1:]])
    for name, table in tables.items():
        write_with_provenance(Path(folder, name), table.to_csv(index=False), command=command)


def main() -> None:
    """Measure, and write the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page", description=__doc__)
    parser.add_argument("--grains", type=int, nargs="+", default=[500, 2000])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--pyodide", help="folder of Pyodide and its NumPy")
    parser.add_argument("--exercises", action="store_true", help="also do all exercises in the page")
    parser.add_argument("--folder", default=".", help="folder of the tables")
    parser.add_argument("--here", type=int, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.here:
        ready = time.perf_counter(), time.process_time()
        print(json.dumps([*ready, here(chosen.here)]))
        return
    asked = set[str]()

    class Listening(Handler):
        def send_head(self) -> Any:
            asked.add(self.path.partition("?")[0].strip("/") or "index.html")
            return super().send_head()

    from playwright.sync_api import sync_playwright

    rows, tables = [], dict[str, pd.DataFrame]()
    program = next(filter(None, map(shutil.which, BROWSERS)))
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        site = Path(scratch, "site")
        write_site(site, wheel_for_browsers(), chosen.pyodide)
        server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Listening, directory=str(site)))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/"
        for number, grains in itertools.product(range(chosen.rounds), chosen.grains):
            browser = playwright.chromium.launch(executable_path=program, args=OPTIONS_OF_BROWSER)
            page = browser.new_page(accept_downloads=True)
            page.set_default_timeout(PATIENCE)
            found = {
                "page": in_page(page, address, grains),
                "desktop": on_desktop(grains),
            }
            memory = workers(os.getpid())[1]
            for where, times in found.items():
                for stage, (wall, cpu) in times.items():
                    size = round(memory) if where == "page" else None
                    rows.append((number, grains, where, stage, round(wall, 2), round(cpu, 2), size))
                    print(*rows[-1], flush=True)
            tables["speed.csv"] = pd.DataFrame(rows, columns=COLUMNS)
            tables["visit.csv"] = visit(site, asked)
            store(tables, chosen.folder)
            if number == 0 and grains == chosen.grains[0]:
                tables["differences.csv"] = differences(page, grains, Path(scratch))
                store(tables, chosen.folder)
            browser.close()
        if chosen.exercises:
            browser = playwright.chromium.launch(executable_path=program, args=OPTIONS_OF_BROWSER)
            page = browser.new_page()
            page.set_default_timeout(PATIENCE)
            columns = ["exercise", "test", "number", "desktop", "page"]
            tables["exercises.csv"] = pd.DataFrame(exercises(page, address), columns=columns)
            browser.close()
            store(tables, chosen.folder)


if __name__ == "__main__":
    main()
