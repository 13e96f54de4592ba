"""The cost model."""

import re

import pytest

import labkit as lk
from labkit.engines import Device
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.plugins.campaigns.cost import cost_table
from labkit.plugins.campaigns.file import campaign_file, read_campaign
from labkit.simulation.cost import TYPICAL, announcement, cost_of_task, rough_time
from labkit.simulation.tasks import RunTask, SpecimenTask
from labkit.specimens.recipe import Recipe

pytestmark = pytest.mark.slow


def plan(text, folder):
    (folder / "c.yaml").write_text(text)
    return read_campaign(folder / "c.yaml")


def expected_seconds(jobs, cores):
    (text,) = re.findall(r"about (.*) on \d+ cores", cost_table(jobs, jobs, cores))
    hours, minutes, seconds = map(int, text.split(":"))
    return 3600 * hours + 60 * minutes + seconds


SEEDS = "engine: {}\nspecimens:\n  a: {{void_ratio: 0.65, grains: {}, seed: [1, 2, 3, 4]}}\n"
ONE = SEEDS + "runs:\n  cv: {{path: cv, specimen: a, strain: {}}}\n"


def test_cost_grows_with_grains_strain_and_engine(tmp_path):
    def cost(*words):
        return plan(ONE.format(*words), tmp_path).runs[0].cost

    small, more, longer = (cost("fused", n, strain) for n, strain in ((1000, 0.1), (4000, 0.1), (1000, 0.4)))
    assert more.grain_steps == pytest.approx(4 * small.grain_steps) and more.disk > small.disk
    assert longer.grain_steps == pytest.approx(4 * small.grain_steps, rel=1e-3) and longer.seconds() > small.seconds()
    assert cost("yade", 1000, 0.1).seconds() > small.seconds()


def test_two_cores_take_half_the_time_of_independent_jobs(tmp_path):
    jobs = plan(ONE.format("fused", 4000, 0.4), tmp_path).jobs
    one, two, many = (expected_seconds(jobs, cores) for cores in (1, 2, 100))
    assert two == pytest.approx(one / 2, abs=1.0)
    longest = max(job.cost.seconds() for job in jobs[4:]) + jobs[0].cost.seconds()
    assert longest * 0.999 <= many < two


def test_the_quick_campaign_has_six_paths_three_densities_and_both_engines():
    found = read_campaign(campaign_file("quick"))
    assert {(run.path.name, run.device.name) for run in found.runs} == {
        (path, engine) for path in ("cv", "cr", "cp", "isoc", "isod", "cyclic_cp") for engine in ("yade", "fused")
    }
    assert len({specimen.recipe.void_ratio for specimen in found.specimens}) == 3 and len(found.runs) == 36
    assert expected_seconds(found.jobs, 2) < 15 * 60


def test_a_dry_run_writes_nothing(tmp_path, labkit_command):
    (tmp_path / "c.yaml").write_text(ONE.format("fused", 150, 0.01))
    done = labkit_command("campaign", "c.yaml", "--dry-run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "4 specimens, 0 consolidations, 4 runs" in done.stdout
    assert re.search(r"about \d+:\d\d:\d\d on \d+ cores", done.stdout) and "of disk space" in done.stdout
    assert [p.name for p in tmp_path.iterdir()] == ["c.yaml"]


def seconds_on(engine, task):
    return cost_of_task(task).seconds({task.device.name: TYPICAL[engine]})


def test_a_task_is_announced_with_engine_grains_steps_and_time(specimen_file):
    state = read_state(specimen_file)
    path = ConstantVolume(strain=0.4)
    slow = RunTask(state=state, path=path, device=Device("yade"))
    steps = round(path.strain / on_grains(path, state.scene).rate / state.scene.time_step)
    grains = state.number_of_grains
    assert announcement(slow).startswith(f"yade, {grains:,} grains, {steps:,} steps, about ")
    assert announcement(slow).endswith(f"; with --engine fused about {rough_time(seconds_on('fused', slow))}")
    assert announcement(slow, steps // 4).startswith(
        f"yade, {grains:,} grains, {steps:,} steps, 25% of them done, about"
    )
    assert "--engine fused" not in announcement(RunTask(state=state, path=path, device=Device("fused")))
    assert seconds_on("yade", slow) > 3.0 * seconds_on("fused", slow)


def test_the_fused_engine_is_suggested_only_if_it_is_much_faster():
    tasks = [
        SpecimenTask(recipe=Recipe(void_ratio=0.67, grains=n), material=Scene(), device=Device("yade"))
        for n in (100, 4000)
    ]
    few, many = map(announcement, tasks)
    assert few.startswith("yade, about ") and "--engine fused" not in few
    assert "--engine fused" in many


def test_the_time_of_a_specimen_includes_compilation_and_the_small_grains_of_its_grading(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # in which no earlier run has compiled the law

    @lk.register_law
    class Fresh(lk.ContactLaw):
        """A law that no test compiles."""

        name = "fresh_for_costs"
        parts = lk.laws.LinearSpring() + lk.laws.Coulomb()

    recipe = Recipe(void_ratio=0.67, grains=1000)
    wide = lk.Scene(grading="uniform smallest=0.1mm largest=0.5mm")
    tasks = [
        SpecimenTask(recipe=recipe, material=scene, device=Device("fused"))
        for scene in (Scene(), wide, Scene(law=Fresh.name))
    ]
    assert cost_of_task(tasks[0]).steps == 10_000 and cost_of_task(tasks[1]).steps > 20_000
    seconds = cost_of_task(tasks[2]).seconds()
    assert announcement(tasks[2]).endswith(
        f", about {rough_time(seconds + 5.0)} with 5 s to compile the contact law, once"
    )


def test_times_are_rounded():
    assert [rough_time(t) for t in (0.2, 59.6, 600.0, 7200.0)] == ["1 s", "60 s", "10 min", "2 h"]


def test_a_command_announces_itself_on_standard_error(labkit_command, tmp_path):
    words = ("specimen", "--void-ratio", 0.67, "--grains", 150, "--engine", "fused", "-o", "s.state.nc")
    done = labkit_command(*words, cwd=tmp_path)
    assert re.fullmatch(
        r"specimen: fused, about 1\d\d grains, about 10,000 steps, about \d+ s( with 5 s to compile .*, once)?\n",
        done.stderr,
    )
    again = labkit_command(*words, cwd=tmp_path)
    assert again.returncode == 0 and again.stderr == ""


def test_a_dry_run_warns_about_inertial_numbers_also_of_quick_settings(tmp_path, labkit_command):
    run = "{path: cp, specimen: a, pressure: [100 kPa, 500 kPa], strain: 0.1}"
    text = f"specimens:\n  a: {{void_ratio: 0.62, grains: 300}}\nruns:\n  cp: {run}\n"
    for settings, number in (("standard", "0.00034"), ("quick", "0.00061 to 0.0014")):
        (tmp_path / "c.yaml").write_text(f"settings: {settings}\n{text}")
        done = labkit_command("campaign", "c.yaml", "--dry-run", cwd=tmp_path)
        *_, said = done.stdout.splitlines()
        assert said.startswith("warning: the inertial number of ") and f" will be about {number}, above the" in said
    slow = text.replace("strain: 0.1", "strain: 0.1, rate: 1")
    (tmp_path / "c.yaml").write_text(slow)
    assert "inertial" not in labkit_command("campaign", "c.yaml", "--dry-run", cwd=tmp_path).stdout
