"""Every plug-in can be deleted, alone or with the others: the commands of the demo run without them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import labkit
from labkit.plugins import PLUGINS
from tests.conftest import PATIENCE

pytestmark = pytest.mark.slow

PACKAGE = Path(labkit.__file__).parent
ADDS = {
    "plugins.campaigns": (["campaign"], [], [], ["open_campaign"]),
    "plugins.laboratory_data": (
        ["measured", "misfit", "calibrate-grains"],
        [],
        [],
        ["laboratory_data", "read_measured"],
    ),
    "plugins.exchange": (
        ["import", "export", "statistics", "paraview"],
        [],
        [],
        ["exchange", "import_state", "register_format"],
    ),
    "plugins.incremental": (["driver"], [], [], []),
    "plugins.umat": (["umat"], [], [], ["model.update"]),
    "plugins.probes": (["probe"], [], [], ["Probes", "Probing", "read_probes", "probe"]),
    "plugins.calibration": (["calibrate"], [], [], ["calibrate", "model.fit"]),
    "plugins.densities": (["density"], [], [], ["density_limits", "specimen_at"]),
    "plugins.pictures": (["picture"], [], [], ["figures.Viewer", "figures.draw_grains"]),
    "plugins.page": (["page"], [], [], []),
    "engines.lammps": ([], ["lammps"], [], []),
}  # commands, engines, constitutive laws and public names
DEMO = """
from labkit.cli import main

def run(*words):
    assert main([str(word) for word in words]) == 0, words

run("specimen", "--void-ratio", 0.67, "--grains", 200, "--seed", 1, "--engine", "fused", "-o", "s.state.nc")
run("run", "cv", "s.state.nc", "--strain", 0.002, "--engine", "fused", "-o", "r.run.nc")
assert main(["verify", "r.run.nc", "--csv", "v.csv"]) in (0, 1)  # 1: C0 errs more than allowed with 200 grains
run("figure", "family", "r.run.nc", "-o", "f.png")
run("info", "r.run.nc")
run("model", "cv", "--void-ratio", 0.67, "--pressure", "500kPa", "--strain", 0.01, "-o", "m.run.nc")
"""
LISTED = """
import contextlib, io, json, sys
import labkit
from labkit.cli import main

def said(*words):
    with contextlib.redirect_stderr(io.StringIO()) as errors, contextlib.redirect_stdout(io.StringIO()) as output:
        try:
            code = main(list(words))
        except SystemExit as ended:  # of --help
            code = ended.code
    return code, errors.getvalue() + output.getvalue()

commands, engines, laws = json.loads(sys.argv[1])
test = ["run", "cv", "soft.state.nc", "--strain", "0.002", "-o", "x.run.nc", "--engine"]
print(json.dumps({
    "names": [*labkit.__all__, *(f"{x}.{name}" for x in ("figures", "model") for name in getattr(labkit, x).__all__)],
    "help": said("--help"),
    "commands": {name: said(name, "x") for name in commands},
    "engines": {name: said(*test, name) for name in engines},
    "laws": {name: said("model", "cv", "--model", name) for name in laws},
    "every_law": list(labkit.model.MODELS),
}))
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the package without its repository, with the kernels that earlier tests have compiled."""
    root = tmp_path_factory.mktemp("copy")
    shutil.copytree(PACKAGE, root / "labkit", ignore=shutil.ignore_patterns("*.pyc.*", "*.tmp.*"))  # being written
    shutil.copytree(PACKAGE.parent / "yade_scripts", root / "labkit" / "yade_scripts")
    return root


@pytest.fixture(params=[*((name,) for name in PLUGINS), PLUGINS], ids=" ".join)
def deleted(request, copy):
    """Names of plug-ins that are missing from the copy."""
    folders = [copy / "labkit" / name.replace(".", "/") for name in request.param]
    for folder in folders:
        folder.rename(copy / folder.name)
    yield request.param
    for folder in folders:
        (copy / folder.name).rename(folder)


def python(copy: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    return subprocess.run(
        [sys.executable, "-P", *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE
    )


def test_labkit_says_what_it_lacks_without_a_plugin(copy, deleted, soft_specimen, tmp_path):
    """The commands of the demo run without all of them."""
    absent = [[name for plugin in deleted for name in ADDS[plugin][k]] for k in (0, 1, 2)]
    labkit.write_state(tmp_path / "soft.state.nc", soft_specimen)
    done = python(copy, tmp_path, "-c", DEMO * (deleted == PLUGINS) + LISTED, json.dumps(absent))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    code, listed = found["help"]
    assert code == 0
    commands = {line.split()[0] for line in listed.splitlines() if line.startswith("  ")}
    for plugin, (adds_commands, _, adds_laws, adds_names) in ADDS.items():
        assert {name in commands for name in adds_commands} <= {plugin not in deleted}, plugin
        assert {name in found["every_law"] for name in adds_laws} <= {plugin not in deleted}, plugin
        assert {name in found["names"] for name in adds_names} <= {plugin not in deleted}, plugin
    for name, (code, said) in (found["commands"] | found["engines"] | found["laws"]).items():
        assert code == 2 and said.count("\n") == 1, said
        assert name in said and f"(not installed: {', '.join(name.rpartition('.')[2] for name in deleted)})" in said, (
            said
        )
    assert (tmp_path / "m.run.nc").exists() == (deleted == PLUGINS)


def test_every_plugin_is_tested():
    assert set(ADDS) == set(PLUGINS)


def test_a_users_engine_may_not_have_the_name_of_a_plugins(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import labkit as lk\n\n\n@lk.register_engine\nclass Mine(lk.Engine):\n    name = 'lammps'\n"
    )
    command = ["specimen", "--void-ratio", "0.67", "--engine", "lammps", "--use", "mine.py", "-o", "s.state.nc"]
    done = python(PACKAGE.parent, tmp_path, "-m", "labkit.cli", *command)
    assert done.returncode == 2 and "name lammps " in done.stderr, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("raise RuntimeError('broken')", "RuntimeError: broken"),
        ("import nothing_of_this_name", "ModuleNotFoundError: No module named 'nothing_of_this_name'"),
        ("import sys; sys.exit(3)", "SystemExit: 3"),
        ("def f(:", "SyntaxError: invalid syntax (plugin.py, line 1)"),
    ],
)
def test_a_plugin_that_fails_is_named_and_left_out(content, said, copy, tmp_path):
    file = copy / "labkit" / "plugins" / "pictures" / "plugin.py"
    whole = file.read_text()
    file.write_text(content)
    try:
        done = python(copy, tmp_path, "-m", "labkit.cli", "--help")
    finally:
        file.write_text(whole)
    assert done.returncode == 0 and "  picture " not in done.stdout
    assert done.stderr == f"labkit: the plug-in pictures is not loaded ({said}): install labkit again\n"
