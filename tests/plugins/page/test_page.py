"""The page in Chromium, served by this computer without a network, and its files on the desktop."""

import threading

import numpy as np
import pytest

import labkit as lk
from labkit.plugins.page.server import serve
from labkit.plugins.page.site import write_site

pytestmark = [pytest.mark.long, pytest.mark.slow, pytest.mark.browser]
PHONE = {"width": 390, "height": 800}
SHORT = lk.paths.ConstantMeanStress(strain=0.004, pressure=2e5)


@pytest.fixture(scope="module")
def address(tmp_path_factory, pyodide, browser_wheel):
    folder = tmp_path_factory.mktemp("page")
    write_site(folder, browser_wheel, pyodide)
    with serve(folder, 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture(scope="module")
def page(browser, address):
    page = browser(viewport=PHONE, accept_downloads=True)
    page.errors = []
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.goto(address + "?exercise=equation")
    page.wait_for_selector("#status[data-ready]")
    yield page
    assert page.errors == []


@pytest.fixture(scope="module")
def state():
    recipe = lk.Recipe(void_ratio=0.62, grains=100, step1_friction=0.05, step1_rolling_friction=0.05)
    return lk.make_specimen(recipe, progress=False)


def finish(page, button):
    """Press a button and wait for the end of the run."""
    runs = int(page.get_attribute("#status", "data-runs") or 0)
    page.click(button)
    page.wait_for_selector(f"#status[data-runs='{runs + 1}']")
    assert page.is_hidden("#error"), page.inner_text("#error")


def downloaded(page, button, file):
    with page.expect_download() as download:
        page.click(button)
    download.value.save_as(file)
    return file


def load_state(page, file):
    page.set_input_files("#state", file)
    page.wait_for_function(
        "!document.getElementById('error').hidden || /^State/.test(status_text())".replace(
            "status_text()", "document.getElementById('status').textContent"
        )
    )


def test_an_exercise_gives_the_numbers_of_the_desktop(page):
    finish(page, "#run")
    page.click("summary")
    for row in page.query_selector_all("#exercise tr")[1:]:
        there, here = (float(cell.inner_text()) for cell in row.query_selector_all("td")[1:])
        assert here == pytest.approx(there, rel=0.05)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    drawn = page.evaluate(
        "[...document.querySelectorAll('article.plot path[stroke-width=\"2\"]')].map((p) => p.getAttribute('d').length)"
    )
    assert len(drawn) == 11 and min(drawn) > 300
    assert page.frame_locator("#viewer").locator("#caption").inner_text().count("contacts") == 1


def test_a_state_of_the_desktop_gives_the_same_run(page, state, tmp_path):
    lk.write_state(tmp_path / "s.state.npz", state)
    load_state(page, tmp_path / "s.state.npz")
    page.select_option("#path", "cp")
    page.fill("[name=strain]", "0.004")
    page.fill("[data-group=path][name=pressure]", "200 kPa")
    finish(page, "#go_on")
    here = lk.Run.open(downloaded(page, "#run_file", tmp_path / "page.run.npz"))
    there = lk.run(state, SHORT, save_every=1, snapshots=25, progress=False)
    np.testing.assert_allclose(here.data["stress"], there.data["stress"], rtol=0.0, atol=1e-4 * 2e5)
    assert here.complete and lk.verify(tmp_path / "page.run.npz")
    assert lk.run(here.state, lk.paths.ConstantVolume(strain=0.001), progress=False).complete
    header = downloaded(page, "#records", tmp_path / "page.csv").read_text().partition("\n")[0]
    assert header.startswith("time [s],axial_strain,strain_xx")
    assert lk.read_state(downloaded(page, "#state_file", tmp_path / "now.npz")).digest() == here.state.digest()


def test_hostile_inputs_are_refused_in_one_sentence(page, state, tmp_path):
    page.fill("[name=grains]", "100000")
    page.click("#run")
    page.wait_for_selector(".wrong [name=grains]")
    assert "at most" in page.inner_text("#error")
    page.fill("[name=grains]", "100")
    lk.write_state(tmp_path / "s.state.npz", state)
    lk.write_state(tmp_path / "s.state.nc", state)
    (tmp_path / "damaged.npz").write_bytes((tmp_path / "s.state.npz").read_bytes()[:-200])
    for name, said in (("damaged.npz", "damaged"), ("s.state.nc", "HDF5")):
        load_state(page, tmp_path / name)
        assert said in page.inner_text("#error") and "\n" not in page.inner_text("#error").strip()
    most = page.evaluate("site.upload.most")
    page.evaluate("site.upload.most = 10")
    load_state(page, tmp_path / "s.state.npz")
    assert "too large" in page.inner_text("#error") and most > (tmp_path / "s.state.npz").stat().st_size
    page.evaluate(f"site.upload.most = {most}")


def test_pauses_goes_on_and_is_reopened_after_its_tab_was_closed(page, browser, address):
    page.fill("[name=strain]", "0.5")  # it must not end before it is paused
    page.click("#go_on")
    page.wait_for_selector("#end:enabled")
    page.click("#pause")
    late_row = "listen({ row: runs.at(-1).at(-1), number: runs.at(-1).length - 1 })"  # was on its way
    page.evaluate(late_row)
    assert page.inner_text("#pause") == "Continue"
    page.click("#pause")
    page.click("#end")
    page.evaluate(late_row)
    assert page.is_disabled("#end") and page.is_enabled("#go_on")
    other = browser(viewport=PHONE)
    other.goto(address)
    other.wait_for_selector("#status[data-ready]")
    other.click("#run")
    other.close(run_before_unload=False)
    again = browser(viewport=PHONE)
    again.goto(address)
    again.wait_for_selector("#status[data-ready]")


FULL = """\
let full = false;
const grow = WebAssembly.Memory.prototype.grow;
WebAssembly.Memory.prototype.grow = function (pages) {
  if (full) throw new RangeError("WebAssembly.Memory.grow(): Maximum memory size exceeded");
  return grow.call(this, pages);
};
addEventListener("message", (event) => {
  if (event.data.full !== undefined) { full = event.data.full; event.stopImmediatePropagation(); }
  if (event.data.broken) { event.stopImmediatePropagation(); throw new Error("a bug"); }
});
"""  # what a browser does whose memory is exhausted, from the message {full: true} on


def test_a_lack_of_memory_is_told_and_another_test_runs(browser, address, tmp_path):
    page = browser(accept_downloads=True)
    page.route("**/worker.js", lambda route: route.fulfill(response=(found := route.fetch()), body=FULL + found.text()))
    page.goto(address + "?exercise=equation")
    page.wait_for_selector("#status[data-ready]")
    page.fill("[name=grains]", "1000")
    page.evaluate("worker.postMessage({full: true})")
    page.click("#run")
    page.wait_for_selector("#error:visible")
    assert "no more memory" in page.inner_text("#error") and page.is_enabled("#run")
    page.evaluate("worker.postMessage({full: false})")
    page.fill("[name=grains]", "100")
    finish(page, "#run")
    page.evaluate("worker.postMessage({broken: true})")  # nothing of this thread is left then
    page.wait_for_selector("#error:visible")
    assert page.is_disabled("#run") and page.is_disabled("#run_file")
    page.wait_for_selector("#run:enabled")
    assert "no more memory" in page.inner_text("#error")
    finish(page, "#run")
    assert lk.open_run(downloaded(page, "#run_file", tmp_path / "r.run.npz")).complete
