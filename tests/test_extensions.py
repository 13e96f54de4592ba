"""User-defined paths, laws, statistics, figures and engines: registered, used and refused.

labkit is not changed, and none of these extensions is in examples/.
"""

import importlib.util
import json
import os
import py_compile
import signal
import subprocess
import sys
import textwrap
import uuid

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.errors import Interrupted
from labkit.grains.state_file import read_state
from tests.conftest import PATIENCE
from tests.killed import signalled

pytestmark = pytest.mark.slow

MINE = '''
"""A typical user file."""

import dataclasses

import numpy as np

import labkit as lk
from labkit.grains.laws.named import RollingResistance
from labkit.quantities.recorded import RECORD


@lk.register_path
@dataclasses.dataclass(frozen=True)
class Oedometer(lk.Path):
    """Axial strain without radial strain."""

    most: float = lk.parameter(0.9, unit="N mm", low=0.0, high=1.0, help="an option with a user-defined unit")

    name = "oedo"
    direction = (0.0, 0.0, 1.0)
    record_strain = 5e-4

    def held(self):
        return (lk.Held("radial strain", "strain", measure=np.eye(3)[:2]),)


@lk.register_law
class Tired(RollingResistance):
    """YADE's rolling-resistance law under another name, for both engines."""

    name = "tired"


@lk.register_statistic("largest_force", long_name="largest normal force", units="N")
def largest_force(snapshot):
    return snapshot.contacts.normal_force.max()


@lk.register_statistic("moment_of_normals", long_name="second moment of the normals", dimensions=("i", "j"))
def moment_of_normals(snapshot):
    n = snapshot.contacts.normal
    return n.T @ n / len(n)


@lk.register_figure("largest")
def largest(run, groups=5, snapshot=-1):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots()
    axes.plot(run["axial_strain"], run["largest_force"])
    return figure, run["largest_force"].to_dataframe().reset_index()
'''

ENGINE = """
import labkit as lk
from labkit.engines.fused import FusedEngine


@lk.register_engine
class Slow(FusedEngine):
    name = "slow"
    version = "7"
"""

RUN = ("--strain", 0.004, "--rate", 40, "--snapshots", 2)


@pytest.fixture(scope="module")
def specimen(tmp_path_factory):
    """About 150 grains at rest."""
    file = tmp_path_factory.mktemp("own") / "s.state.nc"
    lk.make_specimen(lk.Recipe(0.67, grains=150), file=file, progress=False)
    return file


@pytest.fixture
def folder(tmp_path, specimen):
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "engine.py").write_text(ENGINE)
    (tmp_path / "s.state.nc").write_bytes(specimen.read_bytes())
    return tmp_path


@pytest.fixture
def python(folder, forks):
    """Function that returns the JSON that a program prints last. It is run from a file, or with -c without one."""

    def printed(code, file="program.py", **environment):
        code, environment = textwrap.dedent(code), {**os.environ, **environment}
        if file is None:
            command = [sys.executable, "-c", code]
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE
            )
        else:
            (folder / file).write_text(code)
            done = forks.run(program=folder / file, cwd=folder, environment=environment)
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout.strip().splitlines()[-1])

    return printed


# --- the command line -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_a_user_defined_path_law_and_statistics(engine, folder, labkit_command):
    """They work in run, verify and figures."""
    words = ["run", "oedo", "s.state.nc", *RUN, "--most", "0.5 N mm", "--law", "tired", "--engine", engine]
    done = labkit_command(*words, "--use", "mine.py", "-o", "r.run.nc", cwd=folder)
    assert done.returncode == 0, done.stderr
    with netCDF4.Dataset(folder / "r.run.nc") as run:
        known = json.loads(run.path_parameters)
        assert run.getncattr("path") == "oedo" and known["most"] == 0.5 and known["record_strain"] == 5e-4
        assert run.complete == 1 and run.engine == engine and json.loads(run.scene)["law"] == "tired"
        strain = run["strain"][:]
        assert np.isclose(strain[-1, 2, 2], 0.004, atol=1e-5) and np.abs(strain[:, :2, :2]).max() < 1e-12
        assert (run["largest_force"].units, run["largest_force"].long_name) == ("N", "largest normal force")
        for number, record in enumerate(run["contacts/record"][:]):
            first = int(run["contacts/row_size"][:number].sum())
            some = slice(first, first + int(run["contacts/row_size"][number]))
            assert run["largest_force"][record] == run["contacts/normal_force"][some].max()
            n = run["contacts/normal"][some].filled()
            np.testing.assert_allclose(run["moment_of_normals"][record], n.T @ n / len(n), rtol=1e-12)
    done = labkit_command("verify", "r.run.nc", "--use=mine.py", "-o", "v.png", cwd=folder)
    lines = {line[:52].strip(): line.split()[-1] for line in done.stdout.splitlines()}
    for name in (
        "held: radial strain, difference",
        "stored largest_force against its contacts",
        "stored moment_of_normals against its contacts",
    ):
        assert lines[name] == "ok", done.stdout + done.stderr
    for words in (["largest"], ["records", "--variable", "moment_of_normals"]):
        done = labkit_command("figure", *words, "r.run.nc", "--use", "mine.py", "-o", "f.png", cwd=folder)
        assert done.returncode == 0 and (folder / "f.png").read_bytes()[:4] == b"\x89PNG", done.stderr


def test_a_run_of_a_user_defined_path_is_readable_without_its_file(folder, labkit_command):
    words = ["run", "oedo", "s.state.nc", *RUN, "--engine", "fused", "-o", "r.run.nc", "--use", "mine.py"]
    assert labkit_command(*words, cwd=folder).returncode == 0
    run = lk.Run.open(folder / "r.run.nc")
    assert run.complete and run.path is None and run.data["largest_force"].dims == ("time",)
    assert not run.data["largest_force"].isnull().any()
    found = lk.verify(run)
    failed = [finding.name for finding in found if finding.decides and not finding.holds and "norm" not in finding.name]
    assert failed == ["held: path oedo is unknown here, give --use FILE"]  # an unchecked condition does not pass
    assert lk.critical_states({}).empty
    done = labkit_command("critical", "r.run.nc", cwd=folder)
    assert done.returncode == 2 and "path oedo " in done.stderr


def test_a_missing_extension_is_reported(folder, labkit_command):
    words = ["run", "oedo", "s.state.nc", *RUN, "--law", "tired", "--engine", "fused", "-o", "r.run.nc"]
    assert labkit_command(*words, "--use", "mine.py", cwd=folder).returncode == 0
    for words, said in (
        (["run", "oedo", "s.state.nc"], "path 'oedo'"),
        (["specimen", "--void-ratio", 0.67, "--law", "tired"], "--law 'tired'"),
        (["run", "cv", "s.state.nc", "--engine", "slow"], "'slow'"),
        (["figure", "largest", "r.run.nc"], "'largest'"),
        (["info", "r.run.nc", "--most", "0.5"], "--most"),
        (["verify", "r.run.nc"], "law 'tired'"),
    ):
        before = sorted(folder.iterdir())
        done = labkit_command(*words, cwd=folder)
        assert done.returncode == 2 and said in done.stderr and len(done.stderr.strip().splitlines()) == 1, done.stderr
        assert sorted(folder.iterdir()) == before


def test_help_lists_the_options_of_user_defined_paths(folder, labkit_command):
    said = labkit_command("run", "--help", "--use", "mine.py", cwd=folder).stdout
    assert "--most" in said and "an option with a user-defined unit in N mm (default: 0.9)" in " ".join(said.split())
    assert "oedo" in said and "--most" not in labkit_command("run", "--help", cwd=folder).stdout
    done = labkit_command("run", "oedo", "s.state.nc", "--most", "2 N mm", "--use", "mine.py", cwd=folder)
    assert done.returncode == 2 and "0 to 1 N mm" in done.stderr
    done = labkit_command("run", "cv", "s.state.nc", "--most", "0.5", "--use", "mine.py", cwd=folder)
    assert done.returncode == 2 and "--most is not a parameter of cv: leave it out" in done.stderr


def test_a_user_defined_engine(folder, labkit_command):
    for engine in ("slow", "fused"):
        words = ["run", "cv", "s.state.nc", *RUN, "--engine", engine, "--use", "engine.py", "-o", f"{engine}.run.nc"]
        done = labkit_command(*words, cwd=folder)
        assert done.returncode == 0, done.stderr
    with netCDF4.Dataset(folder / "slow.run.nc") as slow, netCDF4.Dataset(folder / "fused.run.nc") as fused:
        assert (slow.engine, slow.engine_version) == ("slow", "7")
        np.testing.assert_array_equal(slow["stress"][:], fused["stress"][:])


def test_files_in_the_environment_and_installed_packages(folder, labkit_process):
    information = folder / "site" / "sand-1.0.dist-info"
    information.mkdir(parents=True)
    (folder / "site" / "sand_paths.py").write_text(MINE)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: sand\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[labkit.extensions]\nsand = sand_paths\n")
    for number, more in enumerate(({"LABKIT_USE": str(folder / "mine.py")}, {"PYTHONPATH": str(folder / "site")})):
        words = ["run", "oedo", "s.state.nc", *RUN, "--engine", "fused", "-o", f"{number}.run.nc"]
        done = labkit_process(*words, cwd=folder, environment={**os.environ, **more})
        assert done.returncode == 0, done.stderr
    (folder / "site" / "sand_paths.py").write_text("import nothing_of_that_name\n")
    more = {**os.environ, "PYTHONPATH": str(folder / "site")}
    done = labkit_process("run", "oedo", "s.state.nc", cwd=folder, environment=more)
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert " sand_paths " in done.stderr


BROKEN = {
    "no such file": (None, "bad.py "),
    "syntax": ("def f(:\n", "cannot be loaded (SyntaxError: "),
    "import": ("import nothing_of_that_name\n", "(bad.py line 1: ModuleNotFoundError: "),
    "exit": ("raise SystemExit(3)\n", "(bad.py line 1: SystemExit: 3)"),
    "name of a path": (MINE.replace('name = "oedo"', 'name = "cv"'), "is refused: name cv "),
    "name of a law": (MINE.replace('"tired"', '"rolling_resistance"'), "rolling_resistance "),
    "name of a variable": (MINE.replace('"largest_force", long', '"stress", long'), "name stress is already the"),
    "name of a quantity": (MINE.replace('"largest_force", long', '"r_u", long'), "name r_u is already the name of a"),
    "name of a figure": (MINE.replace('figure("largest")', 'figure("shares")'), "shares "),
    "name of an engine": (ENGINE.replace('"slow"', '"fused"'), "fused "),
    "dimensions": (MINE.replace('("i", "j")', '("i", "grain")'), "dimensions i,grain are not dimensions of a record"),
}


def test_two_files_with_the_same_name_conflict_and_a_file_may_be_loaded_twice(folder, labkit_command):
    """A copy of the file, as in the folder of a campaign, may be loaded too."""
    (folder / "other.py").write_text(MINE + "# another file\n")
    words = ["run", "oedo", "s.state.nc", *RUN, "--engine", "fused", "-o", "r.run.nc", "--use", "mine.py"]
    done = labkit_command(*words, "--use", "other.py", cwd=folder)
    assert done.returncode == 2 and "name oedo is the name of another path: give another name" in done.stderr
    text = MINE[MINE.index("@lk.register_statistic") : MINE.index('@lk.register_statistic("moment')]
    (folder / "other.py").write_text("import labkit as lk\n\n\n" + text)
    done = labkit_command(*words, "--use", "other.py", cwd=folder)
    assert done.returncode == 2 and "largest_force " in done.stderr
    (folder / "same.py").write_text(MINE)
    done = labkit_command(*words, "--use", "./mine.py", "--use", "same.py", cwd=folder)
    assert done.returncode == 0, done.stderr


def test_a_statistic_that_returns_another_shape_is_refused(folder, labkit_command):
    (folder / "bad.py").write_text(MINE.replace("return n.T @ n / len(n)", "return 3.0"))
    before = sorted(folder.iterdir())
    words = ["run", "cv", "s.state.nc", *RUN, "--engine", "fused", "-o", "r.run.nc", "--use", "bad.py"]
    done = labkit_command(*words, cwd=folder)
    said = "moment_of_normals returned an array of shape () but was registered as an array of shape (3, 3)"
    assert done.returncode == 2 and said in done.stderr
    assert [file for file in sorted(folder.iterdir()) if file.name != "__pycache__"] == before


def test_a_run_resumes_only_with_the_same_statistics(folder, labkit_command):
    words = ["run", "oedo", folder / "s.state.nc", *RUN, "--save-every", 1, "--engine", "fused"]
    words += ["-o", folder / "r.run.nc"]
    done = signalled(signal.SIGKILL, "save", 4, *words, "--use", folder / "mine.py")
    assert done.returncode == -signal.SIGKILL
    with netCDF4.Dataset(folder / "r.run.nc") as run:
        begun = run["stress"][:]
        assert run.complete == 0 and len(begun) == 4
    kept = (folder / "r.run.nc").read_bytes()
    (folder / "less.py").write_text(MINE[: MINE.index("@lk.register_statistic")])
    done = labkit_command(*words, "--use", "less.py", cwd=folder)
    assert done.returncode == 2 and "it has largest_force, moment_of_normals" in done.stderr
    assert (folder / "r.run.nc").read_bytes() == kept
    done = labkit_command(*words, "--use", "mine.py", cwd=folder)
    assert done.returncode == 0, done.stderr
    with netCDF4.Dataset(folder / "r.run.nc") as run:
        assert run.complete == 1
        np.testing.assert_array_equal(run["stress"][:4], begun)
        assert len(run["stress"]) > 4 and np.isfinite(run["largest_force"][:]).all()


# --- Python -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_a_file_from_python(engine, python):
    found = python(
        f"""
        import json
        import labkit as lk
        lk.use("mine.py")
        from labkit.paths.registry import PATHS
        state = lk.read_state("s.state.nc")
        run = lk.run(state, PATHS["oedo"](strain=0.004, rate=40), engine="{engine}", snapshots=1, progress=False)
        names = [finding.name for finding in lk.verify(run) if finding.decides and not finding.holds]
        figure = run.plot("largest")
        print(json.dumps([run.complete, run.path.name, float(run.data["largest_force"][-1]), names,
                          len(figure.axes), run.engine]))
        """,
        MPLBACKEND="Agg",
    )
    assert found[:2] == [True, "oedo"] and found[2] > 0.0 and found[4:] == [1, engine]
    assert [name for name in found[3] if "norm" not in name] == []  # 150 grains are too few


def test_a_file_that_cannot_be_loaded_is_not_passed_to_child_processes(folder, python):
    (folder / "bad.py").write_text("1 / 0\n")
    found = python(
        """
        import json, os
        import labkit as lk
        try:
            lk.use("bad.py")
        except lk.InputError as error:
            field, said = error.field, str(error)
        lk.use("mine.py")
        print(json.dumps([field, said, os.environ["LABKIT_USE"]]))
        """
    )
    assert found[0] == "use" and "ZeroDivisionError" in found[1]
    assert found[2] == str(folder / "mine.py")


SOFT = """
import json
import numpy as np
import labkit as lk
from labkit.grains.state import grains_in_cell
from labkit.engines.fused import FusedEngine

class SoftSpring(lk.laws.LinearSpring):
    @staticmethod
    def force(stiffness, overlap):
        return FACTOR * stiffness * overlap

    @staticmethod
    def energy(stiffness, overlap):
        return 0.5 * FACTOR * stiffness * overlap**2

@lk.register_law
class Soft(lk.ContactLaw):
    name = "soft"
    parts = SoftSpring()

scene = lk.Scene(law="soft", local_damping=0.0)
pair = grains_in_cell(scene, np.full(2, 1e-4), np.array([[0, 0, 0], [0, 0, 1.9e-4]]), np.eye(3) * 1e-3)
spring = scene.normal_stiffness(1e-4, 1e-4) * 1e-5 * 1.9e-4 / 1e-9  # the stress of one contact
print(json.dumps([float(FusedEngine(pair).stress()[2, 2]), float(spring)]))
"""


def test_a_changed_law_is_recompiled(python, tmp_path):
    """Machine code is kept for a file as it is, and never without a file. Other tests write to the common folder."""
    law = {"forces", "stress"}
    for factor, file in (("1.0", "law.py"), ("0.5", "law.py"), ("2.0", None)):
        before = set(tmp_path.rglob("*.o"))
        program = SOFT.replace("FACTOR", factor) + f"# {uuid.uuid4()}\n"
        stress, spring = python(program, file, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
        assert np.isclose(stress, float(factor) * spring, rtol=1e-9)
        names = {file.name.split("-")[0] for file in set(tmp_path.rglob("*.o")) - before}
        assert names >= law if not before else names == (law if file else set())


def test_a_specimen_keeps_the_name_of_its_law(folder, labkit_command):
    words = ["specimen", "--void-ratio", 0.6, "--grains", 120, "--law", "tired", "--engine", "fused"]
    done = labkit_command(*words, "--use", "mine.py", cwd=folder)
    assert done.returncode == 0, done.stderr
    file = folder / "e0.6_f0.15_r0.1_n120_s1_tired.state.nc"
    with netCDF4.Dataset(file) as state:
        assert json.loads(state.scene)["law"] == "tired"
    with pytest.raises(lk.InputError, match=r"state\.nc: law 'tired' .*--use"):
        read_state(file)
    before = file.read_bytes()
    assert labkit_command(*words, "--use", "mine.py", cwd=folder).returncode == 0 and file.read_bytes() == before


LAW = """import labkit as lk


class Spring(lk.laws.LinearSpring):
    @staticmethod
    def force(stiffness, overlap):
        {}


@lk.register_law
class Mine(lk.ContactLaw):
    name = "mine"
    parts = Spring()
"""
SLIDER = (
    LAW.replace("lk.laws.LinearSpring", "lk.laws.Coulomb")
    .replace("force(stiffness, overlap)", "earlier(contact, dt)")
    .replace("parts = Spring()", "parts = lk.laws.LinearSpring() + Spring()")
)
PATH = """import dataclasses
import labkit as lk


@lk.register_path
@dataclasses.dataclass(frozen=True)
class Mine(lk.StressPath):
    name, direction = "mine", {}

    def control(self):
        return {}
"""
ALONG = "lk.Control([[1, 0, 0]], [[1], [1], [0]], [self.pressure])"
MISTAKES = {
    "law, attribute": (LAW.format("return stiffness.stifness"), "bad.py line 7: AttributeError: "),
    "law, attribute of a contact": (SLIDER.format("return contact.stifness"), "bad.py line 7: AttributeError: "),
    "law, energy": (LAW.format("return 2.0 * stiffness * overlap"), " of Spring "),
    "law, not for Numba": (
        LAW.format('return stiffness * float(f"{overlap}") if overlap is None else stiffness * overlap'),
        "law mine cannot be compiled (",
    ),
    "law, two of a kind": (
        LAW.format("return stiffness * overlap").replace("= Spring()", "= Spring() + lk.laws.HertzSpring()"),
        "a contact law has two normal parts: give one",
    ),
    "law, no name": (
        LAW.format("return stiffness * overlap").replace('name = "mine"', "other = 1"),
        "Mine has no name: give it one",
    ),
    "path, direction": (PATH.format("(0, 1)", ALONG), "direction 0,1 "),
    "path, extension": (
        PATH.format("(0, 0, -1)", ALONG),
        "for extension, reverse all three signs and make `strain` negative",
    ),
    "path, shapes": (PATH.format("(0, 0, 1)", "lk.Control([[1, 0]], [[1], [1]], [1])"), "measure (1, 2)"),
    "path, given and free": (
        PATH.format("(0, 1, 1)", ALONG),
        "path mine prescribes the strain rate in y and also lets the servo adjust it",
    ),
    "path, error": (PATH.format("(0, 0, 1)", "self.nothing"), "bad.py line 11: AttributeError: "),
}


@pytest.mark.parametrize(("name", "file"), [*BROKEN.items(), *MISTAKES.items()], ids=[*BROKEN, *MISTAKES])
def test_an_error_in_a_user_file_is_reported_in_one_line(name, file, folder, labkit_command):
    text, said = file
    if text is not None:
        (folder / "bad.py").write_text(text)
    before = {file for file in folder.rglob("*") if "__pycache__" not in file.parts}
    what = ["mine", "s.state.nc", "--pressure", "1MPa"] if name.startswith("path") else ["cv", "s.state.nc"]
    what += ["--law", "mine"] if name.startswith("law") else []
    done = labkit_command("run", *what, *RUN, "--engine", "fused", "--use", "bad.py", "-o", "new.run.nc", cwd=folder)
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert said in done.stderr and (name in MISTAKES or ("--use " in done.stderr and "bad.py" in done.stderr))
    assert {file for file in folder.rglob("*") if "__pycache__" not in file.parts} == before


def test_a_compiled_version_beside_a_file_is_not_executed(tmp_path, labkit_command):
    """Python would prefer it, and nobody can read it before."""
    file, evil = tmp_path / "clean.py", tmp_path / "evil.py"
    file.write_text("x = 1\n")
    evil.write_text(f"open({str(tmp_path / 'hit')!r}, 'w')\n")
    planted = importlib.util.cache_from_source(str(file))
    py_compile.compile(str(evil), planted, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    done = labkit_command("run", "--help", "--use", file)
    assert done.returncode == 0 and not (tmp_path / "hit").exists(), done.stderr


@pytest.mark.parametrize(("file", "said"), [("none.py", "No such file"), (".", "Is a directory")])
def test_a_file_of_the_environment_that_cannot_be_read_is_refused_in_one_line(file, said, tmp_path, labkit_command):
    environment = {**os.environ, "LABKIT_USE": os.path.realpath(tmp_path / file)}
    done = labkit_command("figure", "nothing", "r.run.nc", cwd=tmp_path, environment=environment)
    assert done.returncode == 2 and said in done.stderr and "LABKIT_USE names it" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_file_in_a_folder_whose_name_separates_files_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("LABKIT_USE", "")
    (tmp_path / "x:y").mkdir()
    (tmp_path / "x:y/own.py").write_text("raise SystemExit\n")
    with pytest.raises(lk.InputError, match="has ':' in its path, which separates the files of LABKIT_USE"):
        lk.use(tmp_path / "x:y/own.py")
    assert os.environ["LABKIT_USE"] == ""


ERRORS = ["GeneratorExit", "SystemExit", "BaseException('no')", "BaseExceptionGroup('no', [GeneratorExit()])"]


@pytest.mark.parametrize("error", ERRORS)
def test_any_error_in_a_file_is_said_in_a_sentence(error, tmp_path):
    (tmp_path / "own.py").write_text(f"raise {error}\n")
    with pytest.raises(lk.InputError, match=r"own\.py line 1"):
        lk.use(tmp_path / "own.py")


@pytest.mark.parametrize("error", ["KeyboardInterrupt", "labkit.errors.Interrupted('stopped by signal 15', 143)"])
def test_a_signal_while_a_file_is_loaded_stays_a_signal(error, tmp_path):
    (tmp_path / "own.py").write_text(f"import labkit.errors\nraise {error}\n")
    with pytest.raises((KeyboardInterrupt, Interrupted)):
        lk.use(tmp_path / "own.py")


def test_a_file_that_fails_registers_nothing(tmp_path):
    (tmp_path / "own.py").write_text(
        "import labkit\n\n@labkit.register_shape\nclass Half(labkit.Shape):\n    name = 'half'\n\nraise ValueError\n"
    )
    with pytest.raises(lk.InputError, match=r"own\.py line 7"):
        lk.use(tmp_path / "own.py")
    with pytest.raises(lk.InputError, match="shape 'half' is unknown"):
        lk.Recipe(0.67, shape="half")


def test_a_folder_is_no_file_of_extensions(tmp_path):
    with pytest.raises(lk.InputError, match="is not a file"):
        lk.use(tmp_path)


@pytest.mark.parametrize("kind", [object(), object, 5, None])
@pytest.mark.parametrize("register", ["register_law", "register_path", "register_shape", "register_engine"])
def test_what_is_no_subclass_is_not_registered(register, kind):
    with pytest.raises(lk.InputError, match="is not a subclass of labkit"):
        getattr(lk, register)(kind)


@pytest.mark.parametrize("register", [lk.register_statistic, lk.register_figure])
def test_what_is_no_function_is_not_registered(register):
    with pytest.raises(lk.InputError, match="int is not a function: register one"):
        register("five")(5)
