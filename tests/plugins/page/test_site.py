"""`labkit page`: the static files and the server."""

import json
import re
import threading

import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.page.panels import PANELS
from labkit.plugins.page.server import serve
from labkit.plugins.page.site import STATIC, write_site
from tests.docs.pages import DOCS
from tests.docs.test_links import anchors


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


def test_without_a_wheel_the_page_is_there_and_computes_nothing(tmp_path):
    write_site(tmp_path, None, theory="../theory.html")
    about = json.loads((tmp_path / "page.json").read_text())
    assert about["wheel"] is None and about["theory"] == "../theory.html" and not list(tmp_path.glob("*.npz"))


@pytest.mark.parametrize(("served", "said"), [(True, "labkit page -o FOLDER"), (False, "works only from a web server")])
def test_a_page_that_cannot_compute_says_what_to_do(served, said, tmp_path, browser):
    write_site(tmp_path, None)
    page = browser()
    with serve(tmp_path, 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/" if served else (tmp_path / "index.html").as_uri()
        page.goto(address)
        page.wait_for_selector("#error:not([hidden])")
        assert said in page.inner_text("#error") and page.is_disabled("#run")
        server.shutdown()


def test_panels_link_to_sections_of_the_theory():
    in_page = re.findall(r'data-at="([^"]+)"', (STATIC / "index.html").read_text())
    assert anchors(DOCS / "theory.md") >= {panel.theory for panel in PANELS} | set(in_page)
