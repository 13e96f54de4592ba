"""`labkit page`: the static files and the server."""

import json

import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.page.command import serve


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    wheel = folder / "labkit-0-py3-none-any.whl"
    wheel.write_bytes(b"PK")
    assert main(["page", "-o", str(folder / "page"), "--wheel", str(wheel)]) == 0
    return folder / "page"


def test_writes_files_that_any_server_offers(site):
    about = json.loads((site / "page.json").read_text())
    assert (site / about["wheel"]).is_file() and about["pyodide"].startswith("https://")
    for exercise in about["exercises"]:
        for test in exercise["tests"]:
            assert lk.read_state(site / test["specimen"]).number_of_grains > 150
    names = {"index.html", "page.css", "page.js", "plots.js", "worker.js", "viewer.html"}
    assert names <= {file.name for file in site.iterdir()}


def test_a_server_offers_them_to_this_computer(site):
    with serve(site, 0) as server:
        assert server.server_address[0] == "127.0.0.1"
        with pytest.raises(lk.InputError, match=f"port {server.server_port}"):
            serve(site, server.server_port)


@pytest.mark.parametrize("words", [["--pyodide", "nowhere"], ["--wheel", "nowhere.whl"]])
def test_refuses_what_is_not_there(words, capsys, tmp_path):
    assert main(["page", "-o", str(tmp_path / "page"), *words]) == 2
    assert words[0] in capsys.readouterr().err and not (tmp_path / "page").exists()
