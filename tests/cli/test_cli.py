"""Invalid input: exit code 2, one clear line, no file left behind. Help of every command."""

import os
import re
import shlex
import shutil
import subprocess
import sys

import pytest

from labkit.cli import main
from labkit.cli.dispatch import parse
from labkit.cli.registry import find_command, summaries
from labkit.extensions import is_labkits
from labkit.paths.registry import PATHS
from labkit.results.figures import FIGURES
from tests.changed import changed

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path, specimen_file, run_file):
    """A folder with a good state, a good run and a text file named .nc."""
    shutil.copy(specimen_file, tmp_path / "s.state.nc")
    shutil.copy(run_file, tmp_path / "r.run.nc")
    (tmp_path / "text.nc").write_text("not a netCDF file\n")
    return tmp_path


SPECIMEN = "specimen --grains 200 -o new.state.nc --void-ratio"
BAD = {
    "missing file": ("verify nowhere.run.nc", "nowhere.run.nc"),
    "missing specimen": ("run cv nowhere.state.nc -o new.run.nc", "nowhere.state.nc"),
    "text named nc": ("verify text.nc", "text.nc"),
    "text as specimen": ("run cv text.nc -o new.run.nc", "text.nc"),
    "text as output": ("run cv s.state.nc -o text.nc", "text.nc"),
    "state as run": ("verify s.state.nc", "state file"),
    "state as output run": ("run cv s.state.nc -o s.state.nc", "s.state.nc is also an input"),
    "info on text": ("info text.nc", "text.nc"),
    "void ratio 0": (f"{SPECIMEN} 0", "void-ratio 0"),
    "void ratio missing": ("specimen --grains 200 -o new.state.nc", "--void-ratio"),
    "unknown path": ("run cx s.state.nc -o new.run.nc", "cx"),
    "unknown engine": ("run cv s.state.nc --engine warp -o new.run.nc", "--engine: 'warp'"),
    "pressure above the overlap limit": ("run cr s.state.nc --pressure 5e6 -o new.run.nc", "2 %"),
    "no pressure to consolidate to": ("consolidate s.state.nc -o new.state.nc", "--pressure"),
    "pressure for cv": ("run cv s.state.nc --pressure 1e5 -o new.run.nc", "--pressure "),
    "specimen before the path": ("run s.state.nc cv -o new.run.nc", "give the path first, then the specimen"),
    "a path by its common name": ("run triaxial s.state.nc -o new.run.nc", "give 'cr' (drained), 'cv' (undrained)"),
    "folder that is missing": ("run cv s.state.nc -o no/such/new.run.nc", "no/such"),
    "folder as output": ("run cv s.state.nc -o .", "directory"),
    "folder that cannot be written": ("run cv s.state.nc -o /proc/new.run.nc", "/proc"),
    "specimen that cannot be written": ("specimen --void-ratio 0.67 --grains 200 -o /proc/s.state.nc", "/proc"),
    "a run over a state": (f"{SPECIMEN} 0.67 -o r.run.nc", "run file"),
    "figure over a run": ("verify r.run.nc -o r.run.nc", "is not the name of a figure: give one that ends with .png"),
    "csv over a run": ("verify r.run.nc -o f.png --csv r.run.nc", "run file"),
    "a folder as run": ("verify .", "does not exist"),
    "a rate too fast for the strain": ("run cv s.state.nc --rate 1e4 --strain 1e-3 -o new.run.nc", "steps"),
    "too many threads": ("run cv s.state.nc --threads 100000 -o new.run.nc", "threads"),
    "side and grains": (f"{SPECIMEN} 0.67 --side 2mm", "--side 0.002 "),
    "pressure without a unit": ("run cr s.state.nc --pressure 0.5 -o new.run.nc", "--pressure 0.5 "),
    "unknown law": (f"{SPECIMEN} 0.67 --law hertz", "--law 'hertz'"),
    "unknown settings": (
        "run cv s.state.nc --settings best -o new.run.nc",
        "--settings: 'best' is unknown: give one of quick, standard, reference (see labkit run --help)",
    ),
    "a path of a file that is not loaded": (
        "run ca s.state.nc -o new.run.nc",
        "the file that registers it (--use FILE",
    ),
    "a figure of a file that is not loaded": ("figure mine r.run.nc", "(--use FILE"),
    "a file to use that is not there": ("run cv s.state.nc --use mine.py", "--use mine.py "),
    "a file to use that is not Python": ("run cv s.state.nc --use text.nc -o new.run.nc", "--use "),
    "a material of a specimen for a run": ("run cv s.state.nc --mean-diameter 1mm -o new.run.nc", "--mean-diameter"),
    "unknown command": ("dance", "dance"),
    "no command": ("", "COMMAND"),
    "no run": ("verify", "the following arguments are required: RUN"),
    "rows that are no number": ("verify r.run.nc --rows many", "--rows: 'many' "),
    "misspelled option": ("run cv s.state.nc --treads 2", "--treads is not an option of labkit run: did you mean --"),
    "misspelled command": ("infoo r.run.nc", "COMMAND 'infoo' is unknown: give 'info', or another of specimen, "),
    "misspelled path": ("run CR", "'cr'"),
    "unit apart": (
        "run cp s.state.nc --pressure 300 kPa",
        "kPa stands alone: write the value and its unit without a sp",
    ),
    "unknown option": ("verify r.run.nc --loud", "--loud "),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name, folder, labkit_command):
    words, message = BAD[name]
    before = sorted(folder.iterdir())
    done = labkit_command(*words.split(), cwd=folder)
    assert done.returncode == 2, done.stdout + done.stderr
    assert len(done.stderr.strip().splitlines()) == 1 and message in done.stderr, done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(folder.iterdir()) == before


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become nobody")
def test_a_directory_that_an_ordinary_user_cannot_write():
    code = (
        "import os, sys, labkit.files.writable as files\n"
        "try: os.setuid(65534)\n"
        "except OSError: sys.exit(3)\n"
        "try: files.require_writable('/usr/new.run.nc')\n"
        "except files.InputError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if done.returncode == 3:
        pytest.skip("this root can become no other user, as in a container")
    assert "/usr is not writable" in done.stdout, done.stderr


def test_without_yade_the_message_tells_how_to_install_it(folder, labkit_command):
    environment = {**os.environ, "PATH": str(folder)}
    words = "--engine", "yade", "-o", "new.run.nc"
    done = labkit_command("run", "cv", "s.state.nc", *words, cwd=folder, environment=environment)
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1
    assert "apt-get install yade" in done.stderr
    assert not (folder / "new.run.nc").exists()


def damage(file, group, name, index, value):

    with changed(file) as dataset:
        (dataset[group] if group else dataset)[name][index] = value


@pytest.mark.parametrize(
    ("name", "index", "value"),
    [
        ("contact_grain", 0, 99999),
        ("position", (0, 0), float("nan")),
        ("position", (0, 0), 1e300),
        ("radius", 3, -1e-5),
        ("cell", (2, 2), 0.0),
    ],
)
def test_an_impossible_state_is_refused(name, index, value, folder, labkit_command):
    damage(folder / "s.state.nc", None, name, index, value)
    for words in (["run", "cv", "s.state.nc", "-o", "new.run.nc"], ["info", "s.state.nc"]):
        done = labkit_command(*words, cwd=folder)
        assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1, done.stderr
        assert "s.state.nc is damaged" in done.stderr


def test_a_run_file_without_its_groups_is_refused(folder, labkit_command):
    import netCDF4

    with netCDF4.Dataset(folder / "bare.run.nc", "w") as dataset:
        dataset.labkit_file = "run"
    for words in (["verify", "bare.run.nc"], ["run", "cv", "s.state.nc", "-o", "bare.run.nc"]):
        done = labkit_command(*words, cwd=folder)
        assert done.returncode == 2 and "bare.run.nc is damaged" in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1


def test_runs_of_the_same_name_are_distinguished(folder, labkit_command):
    for name in ("a", "b"):
        (folder / name).mkdir()
        shutil.copy(folder / "r.run.nc", folder / name / "t.run.nc")
    done = labkit_command("verify", "a/t.run.nc", "b/t.run.nc", "-o", "f.png", cwd=folder)
    assert "a/t.run.nc: path cv" in done.stdout and "b/t.run.nc: path cv" in done.stdout


def test_info_shows_the_contents_of_a_file(folder, labkit_command):
    done = labkit_command("info", "r.run.nc", cwd=folder)
    assert done.returncode == 0 and "cv" in done.stdout and "grain" in done.stdout
    done = labkit_command("info", "s.state.nc", cwd=folder)
    assert done.returncode == 0 and "void ratio" in done.stdout


def help_of(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main([*words, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", sorted(summaries()))
def test_the_help_of_every_command_has_a_description_and_an_example(name, capsys):
    text = " ".join(help_of(capsys, name).split())
    command = find_command(name)
    assert text.startswith(f"usage: labkit {name} ") and "--use FILE" in text
    assert text.split("[options]", 1)[1].strip().startswith(command.description) and "Example" not in text
    assert command.description[0].isupper() and command.description.endswith(".")
    assert text.endswith(" ".join(command.examples.split()))


@pytest.mark.parametrize("name", sorted(summaries()))
def test_the_examples_of_the_help_can_be_parsed(name, specimen_file, run_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(specimen_file, "s.state.nc")
    shutil.copy(run_file, "r.run.nc")
    heading, *examples = find_command(name).examples.splitlines()
    assert heading in ("example:", "examples:")
    for example in examples:
        words = shlex.split(example, comments=True)
        assert words[:2] == ["labkit", name]
        if "--help" not in words:
            assert parse(words[1:])[0] is find_command(name).function


def test_labkit_lists_its_commands_at_once(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    text = capsys.readouterr().out
    assert (
        ended.value.code == 0 and all(f"\n  {name} " in text for name in summaries()) and "exit codes: 0 done" in text
    )
    program = "import sys; from labkit.cli import main\ntry: main(['--help'])\nexcept SystemExit: print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout.split()
    assert "labkit.cli.dispatch" in loaded and not {"numpy", "netCDF4", "importlib.metadata"} & set(loaded)


OWN = """
from typing import Annotated

from labkit.cli.arguments import Instance, Option
from labkit.cli.registry import command
from labkit.grains.scene import Scene


@command("modulus", "print Young's modulus in MPa")
def modulus(
    times: Annotated[int, Option("how often")] = 1,
    *,
    material: Annotated[Scene, Instance(Scene, "material")],
    loud: Annotated[bool, Option("with a mark")] = False,
) -> None:
    '''Prints Young's modulus.

    Example:
        labkit modulus 2 --young-modulus 300MPa
    '''
    for _ in range(times):
        print(material.young_modulus / 1e6, "!" * loud)
"""


def test_a_file_of_the_user_adds_a_command(tmp_path, labkit_command):
    (tmp_path / "own.py").write_text(OWN)
    done = labkit_command("modulus", 2, "--young-modulus", "300MPa", "--use", "own.py", "--loud", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "300.0 !\n300.0 !\n"), done.stderr
    environment = {**os.environ, "LABKIT_USE": str(tmp_path / "own.py")}
    done = labkit_command("modulus", "--young-modulus", "300MP", cwd=tmp_path, environment=environment)
    assert done.returncode == 2 and done.stderr.startswith("labkit: --young-modulus 300MP ")
    done = labkit_command("modulus", "0", cwd=tmp_path, environment=environment)
    said = "labkit: TIMES: '0' is not a whole number above 0 (see labkit modulus --help)\n"
    assert (done.returncode, done.stderr) == (2, said)
    done = labkit_command("modulus", "--help", cwd=tmp_path, environment=environment)
    assert done.stdout.startswith("usage: labkit modulus [TIMES] [options]\n\nPrints Young's modulus.\n")
    assert done.stdout.endswith("example:\n  labkit modulus 2 --young-modulus 300MPa\n")
    (tmp_path / "own.py").write_text(OWN.replace('"modulus"', '"verify"'))
    done = labkit_command("verify", "--use", "own.py", cwd=tmp_path)
    assert done.returncode == 2 and "verify is the name of another command" in done.stderr


def test_the_help_of_a_path_has_only_its_options(capsys):
    every, cv, isod = help_of(capsys, "run"), help_of(capsys, "run", "cv"), help_of(capsys, "run", "isod")
    paths = [name for name in PATHS if is_labkits(PATHS[name])]  # other tests may have registered further ones
    assert "--reversals" in every and "--pressure" in every and all(f"\n  {name} " in every for name in paths)
    assert (
        "--reversals" not in cv and "--pressure PRESSURE" not in cv and "--strain STRAIN" in cv and "\n  cv  CV, " in cv
    )
    assert "mean stress below which the test stops" in isod and "stress that the path holds" not in isod


def test_figures_are_explained(capsys):
    text = help_of(capsys, "figure")
    assert all(re.search(rf"^  {name} +\S+", text, re.MULTILINE) for name in FIGURES)


def test_the_command_is_installed():
    done = subprocess.run([sys.executable, "-m", "labkit.cli", "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("labkit ")


def test_a_shell_completes_commands_options_and_paths(labkit_command, tmp_path):
    done = labkit_command("completion", "bash")
    assert done.returncode == 0, done.stderr
    (tmp_path / "labkit.bash").write_text(done.stdout)
    expected = {"labkit spec": "specimen", "labkit specimen --fri": "--friction", "labkit run cycl": "cyclic_cp"}
    for line, word in expected.items():
        words = f"COMP_WORDS=({line}); COMP_CWORD={line.count(' ')}"
        script = f'. ./labkit.bash; {words}; _shtab_labkit; echo "${{COMPREPLY[@]}}"'
        found = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
        assert word in found.stdout.split(), line
