"""Figs. 4 to 10 from the model only."""

from analysis.__main__ import main


def test_figures_are_drawn(tmp_path, capsys):
    assert main(["model-figures", "-o", str(tmp_path)]) == 0
    for number in range(4, 11):
        assert (tmp_path / f"model_fig{number}.png").stat().st_size > 20_000
    capsys.readouterr()
    assert main(["model-figures", "-o", str(tmp_path / "nowhere")]) == 2
    error = capsys.readouterr().err
    assert "nowhere" in error and len(error.strip().splitlines()) == 1
