"""Text of files reaches the terminal without control characters, which could hide lines or rename the window."""

import io
import sys

import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from labkit.cli import main
from labkit.cli.dispatch import report_errors
from labkit.errors import notice
from labkit.process.progress import on_terminal
from tests.changed import changed

HOSTILE = "sand\x1b]0;window\x07\x1b[2K\rsame\x9b1A\u202etxet"
SHOWN = r"sand\x1b]0;window\x07\x1b[2K\rsame\x9b1A\u202etxet"


@pytest.fixture
def printed(capsys):
    """Return what was printed; the last line of a progress bar may replace itself, nothing else may."""

    def text():
        out, error = capsys.readouterr()
        assert not set(out + error) & set("\x1b\x07\r\x9b\u202e")
        return out + error

    return text


@pytest.mark.parametrize(("command", "attribute", "code"), [("info", "title", 0), ("verify", "labkit_file", 2)])
def test_attributes_are_shown_as_escapes(command, attribute, code, specimen_file, tmp_path, printed):
    file = tmp_path / "s.state.nc"
    file.write_bytes(specimen_file.read_bytes())
    with changed(file) as data:
        data.setncattr(attribute, HOSTILE)
    assert main([command, str(file)]) == code
    assert SHOWN in printed()


def test_names_of_files_are_shown_as_escapes(printed):
    assert main(["info", f"{HOSTILE}.state.nc"]) == 2
    assert f"{SHOWN}.state.nc" in printed()


def test_the_message_of_a_users_file_is_shown_as_escapes(tmp_path, printed):
    (tmp_path / "own.py").write_text(f"raise ValueError({HOSTILE!r}.replace(chr(13), str()))")
    assert main(["info", "x", "--use", str(tmp_path / "own.py")]) == 2
    assert SHOWN.replace(r"\r", "") in printed()


def test_the_provenance_of_a_picture_is_shown_as_escapes(tmp_path, printed):
    text = PngInfo()
    text.add_text("provenance", '{"command": "labkit\\u001b[2K"}')
    Image.new("RGB", (2, 2)).save(tmp_path / "a.png", pnginfo=text)
    main(["info", str(tmp_path / "a.png")])
    assert r"labkit\x1b[2K" in printed()


def test_notices_from_python_are_shown_as_escapes(printed):
    notice(HOSTILE)
    assert printed() == f"labkit: {SHOWN}\n"


def test_a_progress_bar_still_replaces_its_line(monkeypatch):
    monkeypatch.setattr(sys, "stdout", screen := io.StringIO())
    monkeypatch.setenv("COLUMNS", str(len(HOSTILE) + 1))
    assert report_errors(lambda: on_terminal(HOSTILE) or 0) == 0
    assert screen.getvalue() == f"\r{SHOWN}" and sys.stdout is screen
