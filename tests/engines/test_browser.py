"""The library for browsers: compiled by zig, and run by Pyodide in Node, where 100 steps give the bits of `plain`."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import labkit as lk
from labkit.engines import browser
from labkit.engines.host import build
from labkit.engines.kernel import machine
from labkit.grains.laws import LAWS
from tests.conftest import PATIENCE, ROOT

CASES = [*LAWS, "clumps", "frictionless"]
FROM_C = {"malloc", "free", "memcpy", "memmove", "memset", "pow", "log"}
OF_LINKER = {"memory", "__indirect_function_table", "__stack_pointer", "__memory_base", "__table_base"}
ONE_LAW = """
import sys
from pathlib import Path
from labkit.engines.kernel import ship
ship.LAWS = ("hertz_mindlin",)
ship.ship_level(Path(sys.argv[1]), ship.WASM)
"""
LIST = """
const module = new WebAssembly.Module(require("fs").readFileSync(process.argv[1]));
const names = (list) => list.map((one) => one.name);
console.log(JSON.stringify([names(WebAssembly.Module.imports(module)), names(WebAssembly.Module.exports(module))]));
"""
IN_NODE = """
import fs from "fs";
const [pyodide, numpy, wheel, program, folder, ...cases] = process.argv.slice(2);
const { loadPyodide } = await import(`${pyodide}/pyodide.mjs`);
const python = await loadPyodide();
await python.loadPackage([numpy, wheel], { messageCallback: () => {} });
python.FS.mkdir("/work");
python.FS.mount(python.FS.filesystems.NODEFS, { root: folder }, "/work");
python.globals.set("__name__", "in_browser");
python.runPython(fs.readFileSync(program, "utf8"));
for (const name of cases)
  python.runPython(`Path("/work/${name}.browser.json").write_text(json.dumps(after("/work", "${name}")))`);
python.runPython(`
from labkit.engines.fused import FusedEngine
try:
    FusedEngine(pickle.loads(Path("/work/${cases[0]}.pickle").read_bytes())[0], precision="mixed")
except Exception as error:
    Path("/work/refusal.json").write_text(json.dumps([type(error).__name__, str(error)]))
`);
"""


def test_a_browser_refuses_what_it_cannot_compile(monkeypatch):
    monkeypatch.setattr(machine, "COMPILES", False)
    for stamp in (None, "of another law"):
        with pytest.raises(lk.InputError, match="a browser compiles nothing"):
            machine.address_of("forces", lambda: None, stamp)
    assert machine.is_kept("forces", "of another law")  # no other process compiles it


@pytest.mark.slow
def test_the_library_of_a_browser_needs_only_c_and_contains_every_function(tmp_path):
    pytest.importorskip("ziglang")
    if not shutil.which("node"):
        pytest.skip("no node here: apt-get install nodejs")
    objects = tmp_path / "objects"
    objects.mkdir()
    settings = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    subprocess.run([sys.executable, "-c", ONE_LAW, objects], cwd=ROOT, env=os.environ | settings, check=True)
    files = sorted(objects.glob("*.o"))
    library = build.build_for_browsers(tmp_path, files)
    done = subprocess.run(["node", "-e", LIST, library], capture_output=True, text=True, check=True)
    imports, exports = map(set, json.loads(done.stdout))
    assert imports <= FROM_C | OF_LINKER
    assert exports >= {file.stem for file in files} | {"advance_double_plain", "compiled_layout"}
    kinds = {file.stem.rpartition("_")[0] for file in files}
    assert kinds >= {"forces", "stress", "move", "start_step", "search_is_due", "distance2", "move_bodies", "fill_arms"}
    assert len([file for file in files if file.stem.startswith("forces_")]) == 2  # with friction and without

    wheel = browser.write_wheel(tmp_path, library)
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        assert [name for name in names if name.endswith(".so")] == [f"labkit/engines/host/{library.name}"]
        assert {"labkit/__init__.py", "labkit/engines/host/host.cpp"} <= set(names)
        record = archive.read(next(name for name in names if name.endswith("RECORD"))).decode()
    assert len(record.splitlines()) == len(names)


@pytest.mark.long
def test_100_steps_of_every_law_in_a_browser_give_the_bits_of_the_level_plain(pyodide, browser_wheel, tmp_path):
    program, run = ROOT / "tests/engines/in_browser.py", tmp_path / "run.mjs"
    subprocess.run([sys.executable, "-W", "ignore", program, tmp_path, *CASES], cwd=ROOT, check=True, timeout=PATIENCE)
    run.write_text(IN_NODE)
    words = ["node", run, pyodide, next(pyodide.glob("numpy-*.whl")), browser_wheel, program, tmp_path, *CASES]
    done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    native, there = (
        {case: json.loads(Path(tmp_path, f"{case}{of}.json").read_text()) for case in CASES} for of in ("", ".browser")
    )
    assert all(found["contacts"] > 100 for found in native.values())
    assert there == native
    kind, text = json.loads(Path(tmp_path, "refusal.json").read_text())
    assert kind == "InputError" and "a browser compiles nothing" in text
