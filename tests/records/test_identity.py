"""Which runs are the same run, and how a message says their differences."""

import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.records.checkpoint import differences
from tests.stopped import run_stopped

PATH = """
path: steps
steps:
  - {{label: {label}, strain: {{zz: {strain}}}}}
  - strain: {{zz: 0.1 %}}
"""


def test_an_edited_comment_or_label_resumes_a_run_and_a_difference_is_said_in_words(soft_specimen, tmp_path):
    def path(strain, comment="", label="first"):
        file = tmp_path / "p.yaml"
        file.write_text(comment + PATH.format(strain=strain, label=label))
        return lk.read_path(file)

    options = {"file": tmp_path / "r.run.nc", "record_strain": 2e-4, "save_every": 1}
    run_stopped(0.4, soft_specimen, path("0.2 %"), **options)
    with pytest.raises(InputError) as refused:
        lk.run(soft_specimen, path("0.3 %"), progress=False, **options)
    assert (
        "strain of step 1 is 0,0,0,0,0,0,0,0,0.002 in the file" in str(refused.value) and len(str(refused.value)) < 500
    )
    run = lk.run(soft_specimen, path("0.2 %", "# a comment\n\n", "another name"), progress=False, **options)
    assert run.complete and run.data.axial_strain[-1] == pytest.approx(0.003, abs=1e-5)


def test_differences_are_few_and_short():
    run = {"path": "steps", "strain": 0.1, "steps": [{"strain": [0.0] * 9, "label": "a"}]}
    assert differences(run, run | {"steps": [{"strain": [0.0] * 9, "label": "b", "durations": [1.0]}]}) == ""
    assert differences(run, run | {"path": "cp", "strain": 0.2}) == "path is steps in the file, cp here"
    longer = run | {"steps": [run["steps"][0]] * 9, **{f"x{k}": k for k in range(5)}}
    said = differences(run, longer)
    assert said.startswith("number of steps is 1 in the file, 9 here; ") and said.endswith(" more differ")
    assert len(said) < 250
    assert differences(run, run | {"steps": [{"strain": [1.23456789] * 9}]}) == "strain of step 1 differs"


def test_the_code_of_a_law_makes_another_run_unless_the_file_is_older():
    run = {"path": "cv", "strain": 0.1}
    assert differences(run, run | {"code_of_law": "a"}) == ""
    assert differences(run | {"code_of_law": "b"}, run | {"code_of_law": "a"}).startswith("code_of_law is b")
