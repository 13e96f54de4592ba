"""The choice between one and several threads: with computed times, and its effect on the engine."""

import collections
import logging

import pytest

from labkit.engines import threads
from labkit.engines.threads import ThreadChoice

pytestmark = pytest.mark.slow

FREE, BUSY = {1: 5e-4, 2: 2.7e-4}, {1: 5e-4, 2: 1.5e-2}  # seconds per step on each number of threads


def simulate(choice, conditions):
    """Run the choice through (seconds, cost) conditions; for each, steps and seconds by number of threads."""
    result = []
    for duration, cost in conditions:
        steps, seconds = collections.Counter(), collections.Counter()
        while seconds.total() < duration:
            count, part = choice.count, choice.steps(50)
            assert 1 <= part <= 50
            choice.record(part, part * cost[count])
            steps[count] += part
            seconds[count] += part * cost[count]
        result.append((steps, seconds))
    return result


def test_free_cores_are_used():
    [(steps, seconds)] = simulate(ThreadChoice(2), [(60.0, FREE)])
    assert steps[2] > 0.98 * steps.total()
    assert steps.total() * FREE[2] > 0.98 * seconds.total()


def test_trials_on_busy_cores_cost_less_than_two_percent():
    [(steps, seconds)] = simulate(ThreadChoice(2), [(60.0, BUSY)])
    assert steps[2] > 0
    assert steps.total() * BUSY[1] > 0.98 * seconds.total()


def test_the_number_of_threads_follows_the_other_work_on_the_cores():
    free, busy, again = simulate(ThreadChoice(2), [(30.0, FREE), (30.0, BUSY), (60.0, FREE)])
    assert free[0][2] > 0.95 * free[0].total()
    assert busy[0][1] > 0.95 * busy[0].total()
    assert again[0][2] > 0.9 * again[0].total()


def test_one_thread_if_several_are_hardly_faster():
    [(steps, _)] = simulate(ThreadChoice(2), [(60.0, {1: 5e-4, 2: 4.9e-4})])
    assert steps[1] > 0.95 * steps.total()


def test_steps_slower_than_a_measurement():
    """With a million grains, every call runs at least one step."""
    [(steps, _)] = simulate(ThreadChoice(2), [(60.0, {1: 0.5, 2: 0.3})])
    assert steps[2] > 0.7 * steps.total()


@pytest.mark.parametrize(("cost", "reports"), [(FREE, 0), (BUSY, 1)], ids=["free", "busy"])
def test_busy_cores_are_reported_once(cost, reports, caplog):
    threads.warn_once.cache_clear()
    with caplog.at_level(logging.WARNING, logger="labkit"):
        simulate(ThreadChoice(2), [(60.0, cost)])
        simulate(ThreadChoice(2), [(60.0, cost)])
    assert sum("continues on 1 thread" in message for message in caplog.messages) == reports
