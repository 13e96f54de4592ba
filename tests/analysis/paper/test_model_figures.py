"""Figs. 4 to 10 from the model only."""

import pytest

from analysis.__main__ import main

pytestmark = pytest.mark.long


def test_figures_are_drawn_into_a_folder_of_the_current_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["model-figures"]) == 0
    names = {f"model_fig{number}.png" for number in range(4, 11)}
    assert {file.name for file in (tmp_path / "model_figures").iterdir()} == names
    assert all((tmp_path / "model_figures" / name).stat().st_size > 20_000 for name in names)


def test_a_file_in_place_of_the_folder_is_refused(tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert main(["model-figures", "-o", str(tmp_path / "taken")]) == 2
    error = capsys.readouterr().err
    assert "taken" in error and len(error.strip().splitlines()) == 1
