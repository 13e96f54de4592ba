"""The report of real results, in a real Chromium without a network: on a screen, on a phone, on paper."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pandas
import pytest
from PIL import Image

import labkit
from analysis.markdown import number
from analysis.paper import runs, web_page
from analysis.paper.command import cost_table
from analysis.paper.condense import condense
from analysis.paper.pieces import CAPTIONS
from analysis.paper.report import costs, report, stock_speed
from labkit.errors import InputError

RESULTS = Path(labkit.__file__).parents[1] / "results"
BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
PHONE = {"width": 390, "height": 844}
NASTY = "a | b *c* `d` <script>alert(1)</script> $e$ [f](g) ^h^ _i_ \\j & &amp; {.k}"


@pytest.fixture(scope="module")
def results(tmp_path_factory, run_file):
    """A results folder with a run of the small specimen, pictures and tables of the repository, and their like."""
    results = tmp_path_factory.mktemp("results")
    shutil.copytree(RESULTS / "hard_cases", results / "hard_cases")
    (results / "speed_error").mkdir()
    for name in ("engines.csv", "settings.csv", "study.nc"):
        shutil.copy(RESULTS / "speed_error" / name, results / "speed_error" / name)
    paper = results / "paper"
    (paper / "runs").mkdir(parents=True)
    condense(run_file, paper / "runs/cv-small.run.nc", "./lab paper")
    shutil.copy(RESULTS / "critical.png", paper / "fig1.png")
    shutil.copy(RESULTS / "micro/shares.png", paper / "strength_shares.png")
    shutil.copy(RESULTS / "micro/groups.png", paper / "not_in_captions.png")
    ends = pandas.read_csv(RESULTS / "critical.csv")
    ends.to_csv(paper / "critical_states.csv", index=False)
    shutil.copy(RESULTS / "model_calibration.csv", paper / "parameters.csv")
    fidelity = pandas.DataFrame(
        {
            "number": ends["run"],
            "label": "M of " + ends["run"],
            "ours": ends["M"],
            "within": ends["M_scatter"],
            "paper_says": 0.92,
            "in_units": abs(ends["M"] - 0.92) / ends["M_scatter"],
            "uncertainty_of": "the window",
            "agrees": np.where(abs(ends["M"] - 0.92) <= ends["M_scatter"], "yes", "no"),
            "explanation": NASTY,
        }
    )
    fidelity.to_csv(paper / "fidelity.csv", index=False)
    cost_table(runs(paper)).to_csv(paper / "campaign.csv", index=False)
    return paper


@pytest.fixture(scope="module")
def file(results, study_command):
    done = study_command("report", results, "-o", results / "report.html")
    assert done.returncode == 0, done.stderr
    return results / "report.html"


@pytest.fixture(scope="module")
def browser():
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if not found:
        pytest.skip("no Chromium here: apt-get install chromium-headless-shell")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found)  # without its sandbox, so that root may
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def opened(browser, file):
    """(page on a phone without a network, what its console and its requests said)."""
    page, said = browser.new_context(viewport=PHONE, offline=True).new_page(), []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("requestfailed", lambda request: said.append(f"failed: {request.url[:100]}"))
    page.on("request", lambda request: said.append(request.url[:100]) if not request.url.startswith("data:") else None)
    page.goto(file.as_uri())
    page.wait_for_load_state("networkidle")
    return page, said


def test_nothing_is_asked_for_and_nothing_complained_about(opened, file):
    assert opened[1] == [file.as_uri()]  # the page itself is all that was read


def test_all_pictures_are_there(opened):
    pictures = opened[0].evaluate("[...document.images].map(i => [i.alt, i.complete, i.naturalWidth])")
    captions = [CAPTIONS["caption"].get(name) for name in ("fig1.png", "strength_shares.png")]
    captions += ["not in captions", CAPTIONS["caption"]["../hard_cases/hard_cases.png"]]
    assert sorted(alt for alt, *_ in pictures) == sorted(captions)
    assert all(complete and width > 0 for _, complete, width in pictures)


def test_links_inside_the_page_have_a_target_of_their_own(opened):
    links = opened[0].evaluate("[...document.querySelectorAll('a[href^=\"#\"]')].map(a => a.getAttribute('href'))")
    ids = opened[0].evaluate("[...document.querySelectorAll('[id]')].map(e => e.id)")
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in links} <= set(ids)
    assert "#picture-fig1" in links and "#where-it-comes-from" in links


def test_a_link_of_the_contents_goes_there(opened):
    page = opened[0]
    page.click("nav a[href='#hard-cases']")
    page.wait_for_function("Math.abs(document.getElementById('hard-cases').getBoundingClientRect().top) < 200")


def test_on_a_phone_tables_scroll_in_their_boxes_and_the_page_does_not(opened):
    page = opened[0]
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    beyond = page.evaluate("""[...document.querySelectorAll('h1, h2, p, img, pre, nav, summary, .table')]
        .filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)""")
    assert beyond == []
    boxes = page.evaluate("""[...document.querySelectorAll('.table')].filter(b => b.scrollWidth > b.clientWidth)
        .map(b => getComputedStyle(b).overflowX)""")
    assert boxes and set(boxes) == {"auto"}


def test_the_tables_show_the_data_and_no_markup_in_it(opened, results):
    rows = opened[0].evaluate("[...document.querySelectorAll('tr')].map(r => [...r.cells].map(c => c.innerText))")
    for row in pandas.read_csv(results / "fidelity.csv").itertuples():
        shown = next(cells for cells in rows if cells[0] == row.label)
        assert float(shown[1].replace("\N{MINUS SIGN}", "-")) == pytest.approx(row.ours, rel=1e-3)
        assert shown[5:7] == [row.agrees, NASTY]


def test_rows_are_coloured_by_agreement(opened):
    colours = opened[0].evaluate("""[...document.querySelectorAll('tr')]
        .filter(r => r.cells[0].innerText.startsWith('M of'))
        .map(r => [r.cells[5].innerText, getComputedStyle(r.cells[1]).backgroundColor])""")
    assert {verdict for verdict, _ in colours} == {"yes", "no"}
    assert len(set(map(tuple, colours))) == 2


def test_dark_where_the_reader_wants_it(browser, file):
    page = browser.new_context(viewport=PHONE, color_scheme="dark").new_page()
    page.goto(file.as_uri())
    of = "(name) => getComputedStyle(document.body)[name].match(/\\d+/g).slice(0, 3).reduce((a, b) => a + +b, 0)"
    assert page.evaluate(of, "color") > 600 > 200 > page.evaluate(of, "backgroundColor")


def test_prints_with_the_folded_tables_open_and_no_cut_figure(browser, file):
    page = browser.new_context(viewport={"width": 690, "height": 1000}).new_page()  # about the width of A4 less margins
    page.goto(file.as_uri())
    page.emulate_media(media="print")
    heights = page.evaluate("[...document.querySelectorAll('details td')].map(c => c.getBoundingClientRect().height)")
    assert heights and min(heights) > 0
    assert set(page.evaluate("[...document.querySelectorAll('figure')].map(f => getComputedStyle(f).breakInside)")) == {
        "avoid"
    }
    pdf = page.pdf(prefer_css_page_size=True)
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 20


def test_its_provenance_lies_beside_it(file, results, labkit_command):
    done = labkit_command("info", file, "--check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "input fidelity.csv" in done.stdout and "./lab report" in done.stdout


def test_cost_is_that_of_the_data(results):
    runs, bench = pandas.read_csv(results / "campaign.csv"), results.parent / "speed_error/engines.csv"
    lines = [line.split(",") for line in bench.read_text().splitlines() if '"stock YADE script' in line]
    stock = float(max(lines, key=lambda words: int(words[0]))[4])
    assert stock_speed(bench) == stock
    total = costs(runs.assign(threads=2), stock).iloc[-1]
    assert total["core time, h"] == pytest.approx(2 * runs["wall_time"].sum() / 3600)
    assert total["wall time, h"] == pytest.approx(runs["wall_time"].sum() / 3600)
    assert total["stock YADE, h"] == pytest.approx((runs["steps"] * runs["grains"]).sum() / stock / 3600)


def test_says_what_is_missing_and_what_makes_it(tmp_path):
    report(tmp_path, tmp_path / "report.html", "./lab report")
    text = (tmp_path / "report.html").read_text()
    missing = re.findall(r"Not there yet: (.*?), made by\s+<code>(.*?)</code>", text, re.DOTALL)
    found = {name: command for names, command in missing for name in names.split(", ")}
    assert found["fidelity.csv"] == "./lab paper" and found["fig10.png"] == "./lab notebooks"
    assert found["pareto_cp.png"] == "./lab speed-error" and found["hard_cases.csv"] == "./lab hard-cases"


def test_pictures_that_are_too_large_together_are_narrowed(tmp_path):
    noise = np.random.default_rng(1).integers(0, 256, (1200, 1700, 3), dtype=np.uint8)
    for name in ("fig1", "fig2", "fig3"):
        Image.fromarray(noise).save(tmp_path / f"{name}.png", compress_level=1)
    report(tmp_path, tmp_path / "report.html", "./lab report")
    assert 1e6 < (tmp_path / "report.html").stat().st_size < web_page.LARGEST


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (14331.0, "14331"),
        (0.90593, "0.9059"),
        (0.92, "0.92"),
        (-1.5e-16, "−1.5 × 10^-16^"),
        (1.2e11, "1.2 × 10^11^"),
        (0.0, "0"),
        (float("nan"), ""),
        (99996.0, "99996"),
        (1e-3, "0.001"),
        (1e6, "1000000"),
    ],
)
def test_numbers_are_as_long_as_they_need(value, text):
    assert number(value).replace("\N{NO-BREAK SPACE}", " ").replace("\N{MINUS SIGN}", "-") == text.replace("−", "-")


def test_no_folder_and_no_pandoc_are_said(tmp_path, monkeypatch, study_command):
    done = study_command("report", tmp_path / "none")
    assert done.returncode == 2 and "./lab paper" in done.stderr
    monkeypatch.setitem(os.sys.modules, "pypandoc", None)  # as where it is not installed
    with pytest.raises(InputError, match=r"pip install '.\[report\]'"):
        report(tmp_path, tmp_path / "report.html", "./lab report")
    assert not (tmp_path / "report.html").exists()
