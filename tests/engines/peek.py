"""The YADE engine with a view into YADE, and states that it reaches."""

from pathlib import Path

import numpy as np

from labkit.engines.yade import YadeEngine, find_script, start_yade

SCRIPT = Path(__file__).parent / "in_yade/peek.py"
INTERVAL = 50  # steps, as in a run


class PeekingEngine(YadeEngine):
    """Evaluates expressions inside YADE."""

    @classmethod
    def start_server(cls, threads):
        return start_yade(threads, SCRIPT, [str(find_script("server.py").parent)])

    def evaluate(self, expression):
        return self.server.ask("evaluate", {"expression": expression}).values["value"]


def reached(state, counts, gradient, engine=YadeEngine):
    """[(State, stress), ...] after the given numbers of steps, in intervals as in a run."""
    running, done, ends = engine(state), 0, []
    for count in counts:
        while done < count:
            running.advance(min(INTERVAL, count - done), gradient)
            done = min(done + INTERVAL, count)
        ends.append((running.state(), np.array(running.stress())))
    return ends
