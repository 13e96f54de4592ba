"""The file of samples of a calibration: cut lines, invalid lines, links, a second writer, a kill, a full disk."""

import json
import os
import random
import signal
import subprocess
import sys
import warnings

import pytest

import labkit as lk
from labkit.plugins.laboratory_data import posterior
from labkit.plugins.laboratory_data.sampling import append_sample, read_samples
from labkit.process.interruption import end_on_signals, is_being_written, only_writer
from tests.conftest import ROOT
from tests.plugins.laboratory_data.test_calibrating import imagined_samples, tests  # noqa: F401

SEED = 5901


@pytest.fixture
def file(tmp_path):
    """Three samples."""
    for one in imagined_samples(3):
        append_sample(one, tmp_path / "s.jsonl")
    return tmp_path / "s.jsonl"


def test_a_line_cut_anywhere_is_left_out_and_replaced(tests, file):  # noqa: F811
    whole, draw = file.read_bytes(), random.Random(SEED)
    start = whole[:-1].rfind(b"\n") + 1
    for size in [start + 1, len(whole) - 2, *(draw.randrange(start + 1, len(whole) - 1) for _ in range(30))]:
        file.write_bytes(whole[:size])
        with pytest.warns(UserWarning, match="its last line was cut off, and its sample is computed again"):
            assert read_samples(tests, file) == imagined_samples(2)
        append_sample(imagined_samples(3)[2], file)
        assert file.read_bytes() == whole


@pytest.mark.parametrize(
    "edit", [lambda text: text[:-1], lambda text: "\n" + text + "\n\n", lambda text: text + "  \n"]
)
def test_blank_lines_and_a_missing_last_newline_lose_nothing(edit, tests, file):  # noqa: F811
    file.write_text(edit(file.read_text()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_samples(tests, file) == imagined_samples(3)
        append_sample(imagined_samples(4)[3], file)
        assert read_samples(tests, file) == imagined_samples(4)


WRONG = {
    "points": [[float("nan")] * 12, [float("inf")] * 12, ["1"] * 12, [True] * 12, [10**400] * 12, [None] * 12],
    "parameters": [{"friction": float("nan"), "rolling_friction": 0.1}, {"friction": "0.1", "rolling_friction": 0.1}],
    "grains": [300.0, 0, -1, "300", True, None],
    "seed": [1.5, -1, "1", None],
    "failure": [None, 1, ["it fell apart"]],
    "seconds": [float("nan"), "1", None],
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_value_is_refused_with_its_line(name, tests, file):  # noqa: F811
    lines = file.read_text().splitlines()
    for value in WRONG[name]:
        changed = json.dumps({**json.loads(lines[1]), name: value})
        file.write_text("\n".join([lines[0], changed, lines[2], ""]))
        with pytest.raises(lk.InputError, match=rf"s\.jsonl line 2: {name} is not valid: delete the line"):
            read_samples(tests, file)


@pytest.mark.parametrize(
    "line",
    ["{}", "[]", "null", "3", "x", "[" * 5000, '{"par{"parameters": {}}', '{"parameters": 3}', "\udcff", '{"a": 1}'],
)
def test_a_line_that_is_no_sample_is_refused_with_its_number(line, tests, file):  # noqa: F811
    file.write_bytes(line.encode(errors="surrogateescape") + b"\n" + file.read_bytes())
    with pytest.raises(lk.InputError, match=r"s\.jsonl line 1 is not a sample: delete the line"):
        read_samples(tests, file)


@pytest.mark.parametrize("name, value", [("points", [1.0]), ("points", []), ("parameters", {"friction": 0.1})])
def test_a_sample_of_other_tests_is_refused_with_its_line(name, value, tests, file):  # noqa: F811
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:2], json.dumps({**json.loads(lines[2]), name: value}), ""]))
    with pytest.raises(lk.InputError, match="line 3 is a sample of other tests or parameters"):
        read_samples(tests, file)


def test_a_second_calibration_on_the_same_file_is_refused(tests, file, monkeypatch):  # noqa: F811
    """The first one has the lock until it ends; a file in another folder is no obstacle."""
    before = file.read_bytes()
    with pytest.raises(lk.InputError, match="samples 6 is not valid: give 8 to 100000"):
        lk.calibrate_grains(tests, samples=6, file=file)
    with only_writer(file), pytest.raises(lk.InputError, match=r"s\.jsonl is being written by another process"):
        lk.calibrate_grains(tests, samples=8, file=file)
    seen = []
    monkeypatch.setattr(posterior, "take_sample", lambda *_: seen.append(is_being_written(file)) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        lk.calibrate_grains(tests, samples=8, file=file)
    assert seen == [True] and not is_being_written(file) and file.read_bytes() == before
    assert os.listdir(file.parent).count(".s.jsonl.lock") == 0


@pytest.mark.parametrize("number, code", [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_calibration_that_is_stopped_says_how_to_resume(number, code, tests, file, monkeypatch):  # noqa: F811
    before = file.read_bytes()
    monkeypatch.setattr(posterior, "take_sample", lambda *_: signal.raise_signal(number))
    with pytest.raises(lk.Interrupted, match=r"same command to resume .*s\.jsonl") as caught, end_on_signals():
        lk.calibrate_grains(tests, samples=8, file=file)
    assert caught.value.code == code and file.read_bytes() == before


APPENDING = """
import os, sys, threading
from labkit.plugins.laboratory_data.sampling import append_sample
from tests.plugins.laboratory_data.test_calibrating import imagined_samples
samples = imagined_samples(400)
for number, one in enumerate(samples):
    append_sample(one, sys.argv[1])
    print(number, flush=True)
"""


@pytest.mark.slow
def test_samples_written_before_a_kill_are_read(tests, tmp_path):  # noqa: F811
    """Killed right after a number of samples is reported, whatever the speed of the computer."""
    file = tmp_path / "s.jsonl"
    for wanted in random.Random(SEED).sample(range(5, 200), 5):
        file.unlink(missing_ok=True)
        command = [sys.executable, "-W", "ignore", "-c", APPENDING, str(file)]
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
            while int(process.stdout.readline()) < wanted:
                pass
            process.send_signal(signal.SIGKILL)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = read_samples(tests, file)
        assert len(found) > wanted and found == imagined_samples(len(found))


def test_a_link_is_not_followed(tests, tmp_path):  # noqa: F811
    (tmp_path / "s.jsonl").symlink_to(tmp_path / "precious.txt")
    with pytest.raises(lk.InputError, match="is a link"):
        append_sample(imagined_samples(1)[0], tmp_path / "s.jsonl")
    assert not (tmp_path / "precious.txt").exists()
