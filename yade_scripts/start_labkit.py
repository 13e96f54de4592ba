"""Starts labkit from a script in YADE, and serves it: for a single run or a job of yade-batch."""

import os
import shutil
import signal
import socket
import subprocess
import sys

import server

ROOT = os.path.dirname(os.path.dirname(os.path.realpath(sys.argv[0])))
BATCH = (
    "yade-batch listens on port 9080, or the next free one, on all networks of this computer, and shows its jobs and "
    "their files there. To keep it from the network: unshare -rn yade-batch ..."
)


def labkit_program():
    """Return the command that starts labkit. Exits with one line if none is found."""
    python = os.environ.get("LABKIT_PYTHON")
    if python:
        return [python, "-P", "-m", "labkit.cli"]
    own = os.path.join(ROOT, ".venv", "bin", "labkit")
    program = own if os.path.exists(own) else shutil.which("labkit")
    if not program:
        print(
            "labkit: found no Python with labkit: run ./lab once, put `labkit` on the PATH, or name the Python in "
            "LABKIT_PYTHON",
            file=sys.stderr,
        )
        sys.exit(2)
    return [program]


def words(positional):
    """Return the command line, either the script's own or a row of the table of yade-batch.

    A column has the name of an option with `_` for `-`; strings are quoted, `*` stands for the default, and `%20` for a
    blank, at which YADE would end the value.
    """
    if not os.environ.get("YADE_BATCH"):
        return sys.argv[1:]
    print(BATCH, file=sys.stderr, flush=True)
    table, _, line = os.environ["YADE_BATCH"].rpartition(":")
    row = server.utils.TableParamReader(table).paramDict()[int(line)]
    columns = {name: text.strip("'\"") for name, text in row.items() if name != "description" and name[0] != "!"}
    for name in columns:
        if row[name][0] in "'\"" and row[name][-1] != row[name][0]:
            advice = "write 200kPa for '200 kPa', or %20 for a blank"
            print(f"labkit: {table}, line {line}: {name} {row[name]} ends at a blank: {advice}", file=sys.stderr)
            sys.exit(2)
    given = {name: text.replace("%20", " ") for name, text in columns.items() if text != "*"}
    first = [given.pop(name) for name in positional if name in given]
    return first + [f"--{name.replace('_', '-')}={text}" for name, text in given.items()]


def run_labkit(command, positional=()):
    """Run a labkit command in its own Python, serve it, and exit with its code.

    `positional` names the arguments of the command that are not options, in order.
    """
    server.close_ports()
    mine, its = socket.socketpair()
    line = [*labkit_program(), command, "--engine=yade", *words(positional)]  # another connection may follow
    environment = {**os.environ, "LABKIT_YADE": str(its.fileno())}
    if os.path.exists(os.path.join(ROOT, "labkit", "__init__.py")):  # a clone
        places = filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))  # an empty one: the current folder
        environment["PYTHONPATH"] = os.pathsep.join([ROOT, *map(os.path.abspath, places)])
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN  # as after `nohup`
    for number in server.SIGNALS[: 2 if ignored else 3]:  # labkit decides how to stop
        signal.signal(number, lambda number, frame: child.send_signal(number))
    child = subprocess.Popen(line, env=environment, pass_fds=[its.fileno()], start_new_session=True)
    its.close()
    server.Server(mine).serve()
    mine.close()
    code = child.wait()
    sys.exit(code if code >= 0 else 128 - code)
