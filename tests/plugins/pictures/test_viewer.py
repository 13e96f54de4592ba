"""The page with grains and forces in 3D, its data read back and the page opened in a browser; values in notebooks."""

import base64
import dataclasses
import json
import re

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.pictures.picture import RATTLER, ratio_colors
from labkit.plugins.pictures.viewer import Viewer

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page(run_file, tmp_path_factory):
    file = tmp_path_factory.mktemp("viewer") / "small.html"
    assert main(["picture", str(run_file), "-o", str(file)]) == 0
    return file


def data_of(text):
    return json.loads(re.search(r"^const RUN = (.*);$", text, re.MULTILINE)[1])


def decoded(text, kind, columns):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, columns)


def test_has_all_snapshots_with_their_grains_and_contacts(page, run_file):
    run, data = lk.Run.open(run_file), data_of(page.read_text())
    assert len(data["snapshots"]) == len(run.snapshots) > 4
    radius = decoded(data["radius"], "<f4", 1)[:, 0]
    far = (run.snapshots[0].radius / radius).mean()
    for shown, snapshot in zip(data["snapshots"], run.snapshots, strict=True):
        position = decoded(shown["position"], "<i2", 3) / 32767 * far + snapshot.cell.sum(axis=1) / 2
        np.testing.assert_allclose(position, snapshot.wrapped_position, atol=1e-4 * far)
        ends = decoded(shown["ends"], "<i2", 6) / 32767 * far
        length = np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1)
        np.testing.assert_allclose(length, snapshot.contacts.branch_length(snapshot.radius), rtol=2e-3)
        assert len(decoded(shown["ratio"], "<f4", 1)) == len(snapshot.contacts) == shown["contacts"]
        assert decoded(shown["ratio"], "<f4", 1).mean() == pytest.approx(1.0)


def test_tension_has_a_sign_and_a_colour_of_its_own(page, run_file):
    last = lk.Run.open(run_file).snapshots[-1]
    force = np.where(np.arange(len(last.contacts)) % 3, 1.0, -1.0) * last.contacts.normal_force
    pulled = dataclasses.replace(last, contacts=dataclasses.replace(last.contacts, normal_force=force))
    text = Viewer(pulled).page
    ratio = decoded(data_of(text)["snapshots"][0]["ratio"], "<f4", 1)[:, 0]
    np.testing.assert_array_equal(np.sign(ratio), np.sign(force))
    assert ('<span hidden><i class="tension">' in page.read_text()) and ('<span ><i class="tension">' in text)
    colors = ratio_colors(np.array([-0.2, -3.0]))
    assert np.abs(colors - RATTLER).max(axis=1).min() > 0.1  # not that of grains without contacts


def test_needs_no_network(page):
    assert re.findall(r"(?:src|href)=|https?://|@import", page.read_text()) == []


def test_a_browser_draws_grains_and_forces(page, browser):
    errors, tab = [], browser(viewport={"width": 390, "height": 700})
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto(page.as_uri())
    if tab.evaluate("gl === null"):
        pytest.skip("this Chromium has no WebGL 2")
    colored = """() => { draw(); const p = new Uint8Array(4 * canvas.width * canvas.height);
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, p);
        let n = 0; for (let k = 0; k < p.length; k += 4) n += p[k] - p[k + 2] > 40; return n / p.length * 4; }"""
    both = tab.evaluate(colored)
    tab.uncheck("#grains")
    tab.fill("#cut", "1")
    forces = tab.evaluate(colored)
    tab.uncheck("#forces")
    nothing = tab.evaluate(colored)
    tab.check("#grains")
    grains = tab.evaluate(colored)
    tab.fill("#cut", "0")
    half = tab.evaluate(colored)
    tab.uncheck("#grains")
    tab.check("#forces")
    letters = tab.evaluate("""[...document.querySelectorAll("b.axis")].map((letter) => {
        const box = letter.getBoundingClientRect(), all = canvas.getBoundingClientRect();
        return box.left >= all.left && box.right <= all.right && box.top >= all.top && box.bottom <= all.bottom;
    })""")
    tab.fill("#least", "2")
    strong = tab.evaluate(colored)
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert errors == []
    assert nothing == 0.0 < strong < forces < grains
    assert half < both and half < grains and letters == [True, True, True]


def test_a_browser_without_webgl_says_so_and_takes_snapshots(page, browser):
    tab = browser()
    tab.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    tab.goto(page.as_uri())
    tab.evaluate("window.onmessage({ source: parent, data: { snapshot: RUN.snapshots[0] } })")
    assert "WebGL" in tab.inner_text("#caption")


def test_refuses_what_it_cannot_show(run_file):
    with pytest.raises(lk.InputError, match="no snapshot with positions"):
        Viewer([])
    with pytest.raises(lk.InputError, match="fewer snapshots"):
        Viewer(list(lk.Run.open(run_file).snapshots) * 1000)


def test_notebooks_show_values_as_tables(run_file, soft_specimen):
    run = lk.Run.open(run_file)
    for value, parts in (
        (run, ("cv on", "complete", "q/p", "small.run.nc")),
        (run.snapshots[-1], ("axial strain", "2.00%", "kPa")),
        (run.scene, ("friction</td>", "0.00017 m", "rolling_resistance")),
        (soft_specimen, (f"{soft_specimen.number_of_grains:,}", "rolling_resistance", "void ratio")),
    ):
        text = value._repr_html_()
        assert text.startswith("<table>") and "nan" not in text and all(part in text for part in parts)
    report = lk.verify(run)
    assert str(report) == "\n".join(map(str, report)) and report._repr_html_().startswith("<pre>records with")
    assert "srcdoc=" in Viewer(run)._repr_html_()
