"""Input files that are damaged, truncated or wrong give one sentence with the line and the word."""

import random

import pytest

from labkit.cli import main
from labkit.errors import InputError
from labkit.paths.step import Here
from labkit.plugins.incremental.driver_file import read_test
from labkit.plugins.incremental.start import read_constants, read_initial
from tests.conftest import ROOT

EXAMPLE = ROOT / "examples/incremental_driver"
ONE = "*TriaxialE1\n10 5 1\n-0.1\n"
ENDS, INVALID, NO_NUMBER = "the file ends before", "is not valid as", "is not a number"
INCREMENTS, LARGE = "number of increments", "has an increment that is too large"
CASES = {  # text of test.inp -> part of the message
    "": "line 1: the first line is empty",
    "\n": "line 1: ",
    ONE: "line 1: '*TriaxialE1' is not the name of an output file",
    "# heading": "line 1: no output file is named before #",
    "o.out\n": "line 1: there are no steps",
    "o.out\n*End\n" + ONE: "line 2: ",
    "o.out\nTriaxialE1\n": "line 2: 'TriaxialE1' ",
    "o.out\n*TriaxalE1\n": "line 2: '*TriaxalE1' is not a keyword of the Incremental Driver: did you mean *TriaxialE1?",
    "o.out\n*Heating\n": "use one of *LinearLoad",
    "o.out\n*TriaxialE1": f"{ENDS} the {INCREMENTS}",
    "o.out\n*TriaxialE1\n10 5 1\n": f"line 3: {ENDS} the change of component 1",
    "o.out\n*TriaxialE1\n*End\n": "line 3: '*End' ",
    "o.out\n*TriaxialE1\n10 5\n-0.1": f"line 3: '10 5' where the {INCREMENTS}, of iterations, and the time",
    "o.out\n*TriaxialE1\n0 5 1\n-0.1": f"line 3: '0' {INVALID} a {INCREMENTS}",
    "o.out\n*TriaxialE1\n10 5 1 : x\n-0.1": f"line 3: 'x' {INVALID} a number after the colon",
    "o.out\n*TriaxialE1\n10 5 1 :\n-0.1": "line 3: no number follows the colon",
    "o.out\n*TriaxialE1\n10 5 0\n-0.1": "line 3: the time 0 is not valid",
    "o.out\n*TriaxialE1\n10 5 1 T 20\n-0.1": "line 3: a change of temperature has no effect",
    f"o.out\n*TriaxialE1\n{'9' * 30} 5 1\n-0.1": f"{INVALID} a {INCREMENTS}",
    "o.out\n*TriaxialE1\n10 5 1\n0x10": f"line 4: '0x10' {NO_NUMBER}",
    "o.out\n*TriaxialE1\n10 5 1\nnan": f"line 4: 'nan' {NO_NUMBER}",
    "o.out\n*TriaxialE1\n10 5 1\n1d400": "line 4: '1d400' is too large",
    f"o.out\n*TriaxialE1\n10 5 1\n-{'9' * 30}": f"line 2: *TriaxialE1: strain {LARGE}",
    f"o.out\n*TriaxialS1\n10 5 1\n-{'9' * 30}": f"line 2: *TriaxialS1: stress {LARGE}",
    "o.out\n*TriaxialE1 ? s1\n10 5 1\n-0.1": "'s1'",
    "o.out\n*TriaxialE1 ? s1 > t2\n10 5 1\n-0.1": f"line 2: 't2' {NO_NUMBER}",
    "o.out\n*LinearLoad\n10 5 1\n*Oblique\n": "line 4: '*Oblique' are not known variables",
    "o.out\n*LinearLoad\n10 5 1\n*Roscoe\n0 1\n": f"line 5: {ENDS} component 2 of 6",
    "o.out\n*LinearLoad\n10 5 1\n*Roscoe\n2 1\n": "line 5: '2' is not valid: give 0 for a strain or 1 for a stress",
    "o.out\n*LinearLoad\n10 5 1\n*Roscoe\n1\n1 1\n": "line 5: '1' where component 1 of 6, a flag and 1 number,",
    "o.out\n*CirculatingLoad\n10 5 1\n*Roscoe\n0 1 2\n": "line 5: '0 1 2' ",
    "o.out\n*Repetition\n2\n": "line 3: '2' where the numbers of steps and of repetitions should be",
    "o.out\n*Repetition\n2 0\n": f"line 3: '0' {INVALID} a number of repetitions",
    f"o.out\n*Repetition\n2 5\n{ONE}*End\n": "line 7: *Repetition in line 2 announces 2 steps, and 1 follow",
    f"o.out\n*Repetition\n1 2\n*Repetition\n1 2\n{ONE}": "line 4: *Repetition within *Repetition is not supported",
    f"o.out\n*Repetition\n1 999999\n{ONE}": "this makes more than",
    "o.out\n*ImportFile\n10 5 1\n": "line 2: *ImportFile lacks the number of columns",
    "o.out\n*ImportFile f.dat | 0\n10 5 1\n": f"line 2: '0' {INVALID} a number of columns",
    "o.out\n*ImportFile f.dat | 2\n10 5 1\n*Cartesian\n0 3\n": f"line 5: '3' {INVALID} a column",
    "o.out\n*ImportFile f.dat | 2\n10 5 1\n*Cartesian\n0\n": "line 5: '0' lacks the number of a column",
    "o.out\n*ImportFile f.dat | 2\n10 5 1\n*Cartesian\n" + "0 0\n" * 6: "line 2: the file 'f.dat' does not exist",
    "o.out\n*ImportFile . | 2\n10 5 1\n*Cartesian\n" + "0 0\n" * 6: "line 2: the file '.' does not exist",
    "o.out\n*ImportFile test.inp | 2\n10 5 1\n*Cartesian\n" + "0 0\n" * 6: "where 2 columns should be: give 2 numbers",
    "o.out\n*ObeyRestrictions\n10 5 1\nsd1 > 0\n": "line 4: 'sd1 > 0' is not a restriction",
    "o.out\n*ObeyRestrictions\n10 5 1\nsd1*2 = 0\n": "line 4: '*2' ",
    "o.out\n*ObeyRestrictions\n10 5 1\nsd7 = 0\n": "line 4: 'sd7' ",
    "o.out\n*ObeyRestrictions\n10 5 1\nsd1 + sd1 = 0\n": "line 4: sd1 appears twice",
    "o.out\n*ObeyRestrictions\n10 5 1\nsd1 + 5*ed1 = 0\n": "line 4: a restriction on both stresses and strains",
    "o.out\n*ObeyRestrictions\n10 5 1\n= 0\n": "line 4: '= 0' restricts no stress or strain",
    "o.out\n*ObeyRestrictions\n10 5 1\n" + "ed1 = 0\n" * 6: "line 2: *ObeyRestrictions: the restrictions on strains",
    "o.out\n*ObeyRestrictions\n10 5 1\n" + "sd1 = 0\n" * 6: "line 2: *ObeyRestrictions: ",
    "o.out\n*PerturbationsE\n10 5 1\n*Rendulic\n0.1\n": "line 2: *PerturbationsE: probes from one state are not steps",
    "o.out\n*RandomWalk\n10 5 1\n*Cartesian\n": "line 2: *RandomWalk: a random path cannot be repeated",
}


@pytest.mark.parametrize("text", CASES, ids=range(len(CASES)))
def test_a_test_file_is_refused_with_its_line_and_word(text, tmp_path):
    file = tmp_path / "test.inp"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        read_test(file)
    message = str(error.value)
    assert CASES[text] in message and message.startswith(str(file)) and "\n" not in message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", f"line 1: {ENDS} the number of stress components"),
        ("six\n", f"line 1: 'six' {INVALID} "),
        ("7\n", "'7' "),
        ("6\n-1\n-1\n", f"line 3: {ENDS} stress component 3 of 6"),
        ("3\n-1\nx\n", f"line 3: 'x' {NO_NUMBER}"),
        ("3\n100\n100\n100\n0\n", "the mean stress is not compressive: give negative stresses"),
        ("3\n-1\n-1\n-1\n", f"line 4: {ENDS} the number of state variables"),
        ("3\n-1\n-1\n-1\n1\nloose\n", f"line 6: 'loose' {NO_NUMBER}"),
    ],
)
def test_initial_conditions_are_refused(text, said, tmp_path):
    file = tmp_path / "initial.inp"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        read_initial(file)
    assert said in str(error.value)


def test_initial_conditions_are_padded_with_zeros(tmp_path):
    file = tmp_path / "initial.inp"
    file.write_text("3 ntens\n-100\n-50\n-60\n4\n0.7\n1.0d-1\n")
    initial = read_initial(file)
    assert initial.state == (0.7, 0.1, 0.0, 0.0) and not initial.isotropic and initial.pressure == 70e3
    assert initial.stress.diagonal().tolist() == [50e3, 60e3, 100e3]


def test_parameters_are_read_and_refused(tmp_path):
    file = tmp_path / "parameters.inp"
    file.write_text("    Linear-Elasticity     # cmname\n2  nprops\n30000.0  E\n0.2  nu\n")
    assert read_constants(file) == [30000.0, 0.2]
    file.write_text("name\n2\n1.0\n")
    with pytest.raises(InputError, match=f"line 3: {ENDS} constant 2 of 2"):
        read_constants(file)


@pytest.mark.parametrize("content", [bytes(range(256)), b"o.out\n\0\n", b"\xff\xfe*\0", bytes(3000)])
def test_binary_files_are_refused(content, tmp_path):
    file = tmp_path / "test.inp"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"line [12]|text"):
        read_test(file)
    for name in ("missing.inp", "."):
        with pytest.raises(InputError, match="cannot be read"):
            read_test(tmp_path / name)


def test_comments_in_latin_1_are_accepted(tmp_path):
    file = tmp_path / "test.inp"
    file.write_bytes("o.out\n*TriaxialE1\n10 5 1 # Zahl der Schritte, größer 0\n-0.1\n".encode("latin-1"))
    assert len(read_test(file).steps) == 1


def test_damaged_copies_of_the_example_give_a_sentence_or_a_path(tmp_path):
    """Lines are removed, doubled or swapped, and characters replaced: no exception but InputError is raised."""
    text, rng, file = (EXAMPLE / "test.inp").read_text(), random.Random(1), tmp_path / "test.inp"
    refused = 0
    for _ in range(300):
        lines = text.splitlines()
        for _ in range(rng.randint(1, 3)):
            k, change = rng.randrange(len(lines)), rng.randrange(4)
            if change == 0:
                del lines[k]
            elif change == 1:
                lines.insert(rng.randrange(len(lines)), lines[k])
            elif change == 2:
                lines[k] = lines[k][: rng.randrange(len(lines[k]) + 1)]
            else:
                at = rng.randrange(len(lines[k]) + 1)
                lines[k] = lines[k][:at] + rng.choice("0-.de*?|:,\t #x=>") + lines[k][at + 1 :]
        file.write_text("\n".join(lines))
        try:
            list(read_test(file).path(rate=10.0).starting_at(2e5).steps_from(Here()))
        except InputError as error:
            refused += 1
            assert str(error).startswith(str(file)) and "\n" not in str(error)
    assert 50 < refused < 290


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "test is missing"),
        (("{test}",), "--on is missing: give a state file, or model"),
        (("{test}", "--on", "model"), "--initial is missing: give initialconditions.inp"),
        (("{test}", "--on", "no.state.nc"), "no.state.nc does not exist"),
        (("no.inp", "--on", "model"), "no.inp cannot be read"),
        (("{test}", "--on", "model", "--initial", "{test}"), "line 1: 'driver.out' "),
        (("{test}", "--on", "model", "--initial", "{initial}", "--parameters", "{initial}"), "line 2: '-200.0'"),
        (("{test}", "--on", "model", "--initial", "{initial}", "--columns", "{initial}"), "is also an input"),
        (("{test}", "--on", "model", "--initial", "{initial}", "--stress-unit", "bar"), "'bar'"),
        (("{test}", "--on", "model", "--initial", "{initial}", "--engine", "yade"), "--engine yade is for grains"),
        (("{test}", "--on", "model", "--initial", "{initial}", "--snapshots", "7"), "--snapshots 7 is for grains"),
        (
            ("{test}", "--on", "model", "--initial", "{initial}", "--stop-when", "inertial_number > 1"),
            "inertial_number",
        ),
    ],
)
def test_the_command_refuses_in_one_line(arguments, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = {}
    for name, source in (("test", "test.inp"), ("initial", "initialconditions.inp")):
        files[name] = tmp_path / source
        files[name].write_bytes((EXAMPLE / source).read_bytes())
    assert main(["driver", *(word.format(**files) for word in arguments)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and said in lines[0], lines
    assert {file.name for file in tmp_path.iterdir()} == {"test.inp", "initialconditions.inp"}


def on_model(folder, output, strain, stress):
    """Carry out a compression of the model from axial and radial stresses, kPa; return the exit status."""
    (folder / "t.inp").write_text(f"{output}\n*TriaxialE1\n100 10 1\n{strain}\n")
    axial, radial = stress
    (folder / "initial.inp").write_text(f"6\n{axial}\n{radial}\n{radial}\n0\n0\n0\n1\n0.67\n")
    return main(["driver", str(folder / "t.inp"), "--on", "model", "--initial", str(folder / "initial.inp")])


def test_a_test_that_does_not_begin_writes_no_columns(tmp_path):
    """The run file of an earlier test is not its result."""
    assert on_model(tmp_path, "old.out", -0.01, (-200, -200)) == 0
    assert on_model(tmp_path, "new.out", -0.02, (-900, -10)) == 1
    assert (tmp_path / "old.out").exists() and not (tmp_path / "new.out").exists()


def test_the_imported_file_is_not_overwritten(tmp_path, capsys):
    assert on_model(tmp_path, "ref.out", -0.01, (-200, -200)) == 0
    before, test = (tmp_path / "ref.out").read_bytes(), tmp_path / "import.inp"
    strains = "".join(f"0 {column}\n" for column in range(3, 9))
    test.write_text(f"ref.out\n*ImportFile ref.out | 35\n10 5 1\n*Cartesian\n{strains}")
    capsys.readouterr()
    assert main(["driver", str(test), "--on", "model", "--initial", str(tmp_path / "initial.inp")]) == 2
    assert "ref.out is also an input" in capsys.readouterr().err
    assert (tmp_path / "ref.out").read_bytes() == before


@pytest.mark.parametrize("text", [", ,\n", "1\n-100\n, ,\n"])
def test_a_line_of_commas_is_no_number(text, tmp_path):
    (tmp_path / "initial.inp").write_text(text)
    with pytest.raises(InputError, match="', ,' "):
        read_initial(tmp_path / "initial.inp")
