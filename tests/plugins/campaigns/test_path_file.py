"""Path files and the steps of a campaign: values with units, repetition, and every error with its line."""

import json
import shlex

import pytest

import labkit as lk
from labkit.cli import main
from labkit.cli.simulate import named_path
from labkit.errors import InputError
from labkit.paths.path_file import read_path
from labkit.paths.registry import make_path
from labkit.paths.variables import increments
from labkit.plugins.campaigns.file import read_campaign
from labkit.plugins.campaigns.jobs import Job
from tests.cli.options import run_options

STEPS = """\
  - strain: {zz: 2 %}
    stress: {xx: 0, yy: 0 kPa}
    until: q/p > 0.8
  - repeat: 3
    steps:
      - {stress: {q: -40 kPa}, variables: roscoe, records: 5}
      - {repeat: 2, steps: [{strain: {xz: 1e-3}, label: shear}]}
  - {stress: {xx: 0.3 MPa, yy: 300 kPa, zz: 300e3}, absolute: true, over: 1 %}
"""
LABEL = "step in line"
EXPECTED = (
    increments({"xx": 0.0, "yy": 0.0}, {"zz": 0.02}, until="q/p > 0.8", label=f"{LABEL} 4"),
    increments({"q": -40e3}, variables="roscoe", records=5, label=f"{LABEL} 9"),
    increments(strain={"xz": 1e-3}, label="shear"),
    increments({"xx": 3e5, "yy": 3e5, "zz": 3e5}, absolute=True, over=0.01, label=f"{LABEL} 11"),
)


@pytest.fixture
def written(tmp_path):
    def write(text, name="own.yaml"):
        file = tmp_path / name
        file.write_text(text)
        return file

    return write


def test_steps_in_a_path_file(written):
    path = read_path(written(f"path: steps\npressure: 300 kPa\nsteps:\n{STEPS}"))
    assert path.steps == EXPECTED and path.order == (0, *(1, 2, 2) * 3, 3) and path.pressure == 3e5


def test_a_table_gives_the_rows_of_a_step(written):
    """They are differences between rows of the table, in the units of the headings, or the stresses if absolute."""
    written("strain_zz [%],stress_xx [kPa]\n0,300\n1,350\n0.5,320\n", "t.csv")
    file = written("path: steps\nsteps:\n  - {table: t.csv}\n  - {table: t.csv, absolute: true}\n")
    zz = [0.01, -0.005]
    changes, reached = read_path(file).steps
    assert changes == increments({"xx": [50e3, -30e3]}, {"zz": zz}, label=f"{LABEL} 3")
    assert reached == increments({"xx": [350e3, 320e3]}, {"zz": zz}, absolute=True, label=f"{LABEL} 4")
    assert changes.rows == 2 and changes.strains[1, 2, 2] == -0.005


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_table_of_a_spreadsheet_gives_the_same_rows(written, encoding):
    """With a mark, semicolons, decimal commas and a title."""
    table = "My path\nstrain_zz [%];stress_xx [kPa]\n0;300\n1;350\n0,5;320\n"
    written("", "t.csv").write_bytes(table.encode(encoding))
    (changes,) = read_path(written("path: steps\nsteps:\n  - {table: t.csv}\n")).steps
    assert changes == increments({"xx": [50e3, -30e3]}, {"zz": [0.01, -0.005]}, label=f"{LABEL} 3")


@pytest.mark.parametrize(
    ("table", "error"),
    [
        ("zz,xx\n1,2\n2,3\n", "has the column 'zz' and 2 rows: give two rows or more, and columns such as"),
        ("strain_zz\n1\n", "'strain_zz'"),
        ("strain_zz\n1\nx\n", "cannot be read as a table of numbers"),
        ("strain_zz [bar]\n1\n2\n", "has the column 'strain_zz [bar]', whose unit 'bar' is unknown: give one of "),
        (
            "stress_xx,strain_zz [%]\n310,0\n320,1\n",
            "has the column 'stress_xx' without a unit: give `stress_xx [kPa]`",
        ),
        ("strain_zz\n0\n1\n", "has the column 'strain_zz' without a unit: give `strain_zz [%]`"),
        ("stress_xx [kPa],stress_xx [Pa]\n1,1\n2,2\n", "has two columns of stress_xx: give one of them"),
        ("strain_q [%]\n1\n2\n", "strain 'q'"),
        (None, "t.csv"),
    ],
)
def test_a_table_that_is_none_is_refused_in_one_line(written, table, error):
    if table is not None:
        written(table, "t.csv")
    with pytest.raises(InputError) as raised:
        read_path(written("path: steps\nsteps:\n  - {table: t.csv}\n"))
    assert "line 3: steps, step 1: " in str(raised.value) and error in str(raised.value)


def test_a_path_of_labkit_in_a_path_file(written):
    file = written("path: cp\npressure: 300 kPa\nstrain: 5 %\n")
    assert read_path(file) == lk.paths.ConstantMeanStress(pressure=3e5, strain=0.05)
    small = written("path: isod\npressure: 50 Pa\n")
    assert read_path(small).pressure == 50.0


@pytest.mark.parametrize(
    ("text", "errors"),
    [
        ("", ["line 1: a path file holds `path:` and its parameters, see docs/paths.md"]),
        ("[1, 2", ["line 1: this is not YAML"]),
        ("path: cq\n", ["line 1: the file: path 'cq'"]),
        ("pressure: 1 MPa\n", ["line 1: the file: path "]),
        ("path: cp\npressure: 3 Torr\nfoo: 1\n", ["line 2: the file: pressure 3 Torr ", "line 3: the file: 'foo'"]),
        ("path: cv\nstrain: 0\n", ["line 2: the file: strain 0 "]),
        ("path: cv\nsteps: []\n", ["line 2: the file: 'steps'"]),
        ("path: steps\n", ["line 1: the file: steps is missing: give a list of steps"]),
        ("path: steps\nsteps: 5\n", ["line 2: steps is not a list of steps"]),
        ("path: steps\nsteps:\n  - {over: 1 %}\n", ["line 3: steps, step 1: changes nothing"]),
        (
            "path: steps\nsteps:\n  - {strain: {zz: 0.1}, table: a.csv}\n",
            ["line 3: steps, step 1: has increments and a table"],
        ),
        ("path: steps\nsteps:\n  - {strain: {p: 1}}\n", ["line 3: steps, step 1: strain: 'p'"]),
        ("path: steps\nsteps:\n  - {stress: {zz: 5}}\n", ["line 3: steps, step 1: stress: zz 5 "]),
        (
            "path: steps\nsteps:\n  - {stress: {zz: 5 kPa}, strain: {zz: 0.1}}\n",
            ["line 3: steps, step 1: stress zz and strain zz "],
        ),
        ("path: steps\nsteps:\n  - strain: {zz: 1 %}\n    until: q >\n", ["line 4: steps, step 1: until 'q >'"]),
        ("path: steps\nsteps:\n  - {repeat: 3}\n", ["line 3: steps, step 1: has nothing to repeat"]),
        (
            "path: steps\nsteps:\n  - repeat: 99999\n    steps: [{strain: {zz: 0.1}}, {strain: {zz: -0.1}}]\n",
            ["line 3: steps, step 1: makes 199998 steps: give at most 100000"],
        ),
        ("path: steps\nsteps: " + "[{repeat: 1, steps: " * 7 + "[{}]" + "}]" * 7, ["nests more than 5 repetitions"]),
    ],
)
def test_every_error_has_its_line(written, text, errors):
    with pytest.raises(InputError) as error:
        read_path(written(text))
    lines = str(error.value).splitlines()
    assert len(lines) == 1 + len(errors), lines
    assert all(said in line for said, line in zip(errors, lines[1:], strict=True)), lines


def test_a_file_that_is_not_text_is_refused(written, tmp_path):
    (tmp_path / "own.yaml").write_bytes(b"\xff\xfe\0")
    with pytest.raises(InputError, match="UTF-8"):
        read_path(tmp_path / "own.yaml")
    with pytest.raises(InputError, match=r"none.yaml"):
        read_path(tmp_path / "none.yaml")


def commanded_path(words):
    """The path of a command line, from its options and its path file."""
    given = run_options(words[1:])
    kind, values = named_path(given["path"])
    return make_path(kind.name, {**values, **given["loading"]})


def test_options_replace_what_the_file_says(written):
    file = written("path: cp\npressure: 300 kPa\nstrain: 5 %\n")
    path = commanded_path(["run", str(file), "s.state.nc", "--strain", "1 %"])
    assert path == lk.paths.ConstantMeanStress(pressure=3e5, strain=0.01)


CAMPAIGN = """\
engine: fused
specimens: {dense: {void_ratio: 0.62, grains: 200}}
runs:
  own:
    path: steps
    specimen: dense
    pressure: [200 kPa, 300 kPa]
    stop_when: q/p > 1
"""


def test_the_steps_of_a_campaign_are_those_of_its_jobs_and_of_their_commands(written):
    text = CAMPAIGN + "    steps:\n" + "".join(f"    {line}\n" for line in STEPS.splitlines())
    jobs = read_campaign(written(text, "c.yaml")).runs
    assert [job.path.pressure for job in jobs] == [2e5, 3e5] and len(jobs) == 2
    for job in jobs:
        assert Job.from_values(json.loads(job.to_json())) == job
        words = shlex.split(job.command)[1:]
        assert commanded_path(words) == job.path and run_options(words[1:])["recording"].stop_when == "q/p > 1"
    assert [step.label for step in jobs[0].path.steps][2] == "shear"
    moved = read_campaign(written("# a comment\n" + text.replace("label: shear", "label: back"), "e.yaml")).runs
    assert moved[0].path != jobs[0].path and [job.digest for job in moved] == [job.digest for job in jobs]
    other = read_campaign(written(text.replace("q/p > 0.8", "q/p > 0.7"), "f.yaml")).runs
    assert other[0].digest != jobs[0].digest
    with pytest.raises(InputError, match="line 4: run own: steps "):
        read_campaign(written(CAMPAIGN, "d.yaml"))


@pytest.mark.slow
def test_the_model_takes_a_path_file(written, tmp_path, capsys):
    file = written("path: steps\nsteps:\n  - {strain: {zz: 1 %}, stress: {xx: 0, yy: 0}, until: q/p > 0.4}\n")
    output = tmp_path / "m.run.nc"
    arguments = ["model", str(file), "--void-ratio", "0.67", "--pressure", "300kPa", "-o", str(output)]
    assert main(arguments) == 0
    run = lk.open_run(output)
    assert float(run.lab.stress_ratio()[-1]) > 0.4 and float(run["path_step_progress"][-1]) < 1.0
