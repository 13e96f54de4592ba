"""Campaign files that expand exponentially, contain themselves or shell commands are refused with the line."""

import resource

import pytest
import yaml
from hypothesis import given, settings

import labkit as lk
from analysis.fuzz.damage import damaged_campaigns
from labkit.paths.path_file import read_path
from labkit.plugins.campaigns.file import read_campaign

SPECIMENS = "specimens: {dense: {void_ratio: 0.62, grains: 100}}\n"
RUNS = "runs: {cv: {path: cv, specimen: dense}}\n"
SECONDS = 20.0  # s of processor time: far more than these files need, far less than an exponential expansion
LAUGHS = "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10))
CHAIN = "".join(f"  s{k}: {{from: s{k - 1}, pressure: {100 + k % 2000} kPa}}\n" for k in range(1, 4001))
RING = "".join(f"  s{k}: {{from: s{(k + 1) % 3000}, pressure: 1 MPa}}\n" for k in range(3000))
PRESSURES = ", ".join(f"{k} kPa" for k in range(100, 2800))

HOSTILE = {
    "aliases that explode": (f"a0: &a0 [x, x]\n{LAUGHS}{SPECIMENS}{RUNS}", "line 6: its aliases stand for more"),
    "an alias of itself": (f"{SPECIMENS}runs: &r {{cv: *r}}\n", "line 2: its aliases"),
    "a key twice": (SPECIMENS + RUNS + RUNS, "line 3: 'runs' "),
    "a specimen twice": (f"specimens:\n  a: {{void_ratio: 0.6}}\n  a: {{void_ratio: 0.7}}\n{RUNS}", "line 3: 'a' is"),
    "a ring of specimens": (f"specimens:\n{RING}{RUNS}", "line 2: specimen s0 is derived from itself"),
    "too many runs": (
        f"{SPECIMENS}runs:\n  cp: {{path: cp, specimen: dense, pressure: [{PRESSURES}], engine: [fused, yade]}}\n"
        f"  cr: {{path: cr, specimen: dense, pressure: [{PRESSURES}], engine: [fused, yade]}}\n",
        "line 4: with this entry there are more than 10000 runs",
    ),
    "a billion seeds": (f"specimens: {{dense: {{void_ratio: 0.6, seed: 1e9}}}}\n{RUNS}", None),
    "deep nesting": (f"{SPECIMENS}runs: {'[' * 5000}{']' * 5000}\n", "line"),
    "a large file": ("# " + "x" * 2_000_000, "has more than 1 MB"),
}
NAMES = [
    "../x",
    "a/b",
    "/etc/passwd",
    "a'b",
    'a"b',
    "$(touch x)",
    "`touch x`",
    "a\nb",
    "a;b",
    "a b",
    "-rf",
    "",
    "é",
    "a" * 99,
]


@pytest.fixture
def bounded():
    """Fail if the test needs much processor time."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_utime - before < SECONDS


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_with_its_line(name, tmp_path, bounded):
    text, message = HOSTILE[name]
    file = tmp_path / "c.yaml"
    file.write_text(text)
    if message is None:
        assert len(read_campaign(file).specimens) == 1
        return
    with pytest.raises(lk.InputError, match=message):
        read_campaign(file)
    assert list(tmp_path.iterdir()) == [file]


def test_a_long_chain_of_specimens_is_read_in_order(tmp_path, bounded):
    file = tmp_path / "c.yaml"
    file.write_text(
        f"specimens:\n  s0: {{void_ratio: 0.6, grains: 100}}\n{CHAIN}runs: {{cv: {{path: cv, specimen: s9}}}}\n"
    )
    campaign = read_campaign(file)
    assert [job.name for job in campaign.consolidations] == [f"s{k}" for k in range(1, 4001)]
    assert campaign.consolidations[-1].source == "specimens/s3999.state.nc"


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_a_shell_or_a_folder_could_misunderstand_is_refused(name, tmp_path):
    file = tmp_path / "c.yaml"
    for text in (
        yaml.safe_dump({"specimens": {name: {"void_ratio": 0.6}}, "runs": {"cv": {"path": "cv", "specimen": name}}}),
        yaml.safe_dump({"specimens": {"a": {"void_ratio": 0.6}}, "runs": {name: {"path": "cv", "specimen": "a"}}}),
        yaml.safe_dump({"name": name, **yaml.safe_load(SPECIMENS + RUNS)}),
    ):
        file.write_text(text)
        with pytest.raises(lk.InputError, match=r"line \d+: "):
            read_campaign(file)
    assert list(tmp_path.iterdir()) == [file]


@settings(max_examples=20)
@given(text=damaged_campaigns())
def test_damaged_files_are_read_or_refused_with_a_line(text, tmp_path, bounded):
    """Random changes of a valid file, as `./lab fuzz --campaigns N` makes them with other seeds."""
    file = tmp_path / "c.yaml"
    file.write_text(text, errors="surrogatepass")
    for read in (read_campaign, read_path):
        try:
            read(file)
        except lk.InputError as error:
            assert "line " in str(error) or "UTF-8" in str(error), error
