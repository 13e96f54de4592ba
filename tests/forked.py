"""Commands in processes forked from one that has imported labkit, which saves a second for every command.

A command still runs in a separate process, with its own command line, working folder, environment and exit code.
Settings that a new interpreter reads when it starts, such as PYTHONPATH, are those of the tests; to change them,
start a separate process.
"""

import atexit
import gc
import importlib
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 1800  # s, after which a command is killed
PROGRAMS = {"labkit": "labkit.cli", "analysis": "analysis.__main__"}
IMPORTED = (
    *PROGRAMS.values(),
    "labkit.plugins.campaigns",
    "labkit.cli.dispatch",
    "labkit.engines.fused",
    "labkit.engines.yade",
    "labkit.model",
    "labkit.results.dataset",
    "labkit.results.verify",
    "labkit.figures",
    "matplotlib.pyplot",
)


class Forks:
    """Starts the process with labkit at the first command, and ends it with the context."""

    def __init__(self):
        self._server = None

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self._server is not None:
            self._server.stdin.close()
            self._server.stdout.close()
            self._server.wait()

    def run(self, *words, cwd=None, environment=None, program="labkit"):
        """Run a program with these words as a user would; returns the finished process with its output as text.

        `program` is one of PROGRAMS or a Python file.
        """
        if self._server is None:
            command = [sys.executable, "-m", "tests.forked"]
            self._server = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        words = [str(word) for word in words]
        with tempfile.TemporaryDirectory() as folder:
            files = [f"{folder}/{name}" for name in ("stdout", "stderr")]
            request = str(program), words, str(cwd or os.getcwd()), dict(environment or os.environ), files
            print(json.dumps(request), file=self._server.stdin, flush=True)
            code = int(self._server.stdout.readline())
            return subprocess.CompletedProcess(words, code, *(Path(file).read_text() for file in files))


def serve():
    """Reads one request per line from stdin and writes its exit code; in a forked process, returns what to run."""
    for line in sys.stdin:
        program, words, folder, environment, files = json.loads(line)
        child = os.fork()
        if child == 0:
            become(words, folder, environment, files)
            return program, words
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
    return None


def become(words, folder, environment, files):
    """Gives this process the command line, folder, environment and output of a request."""
    signal.alarm(LIMIT)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv[1:], sys.path[0] = words, folder
    for descriptor, file in zip((0, 1, 2), ("/dev/null", *files), strict=True):
        opened = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
        os.dup2(opened, descriptor)
        os.close(opened)


def finish(program, words):
    """Run a program and end the process, without the half second in which an interpreter shuts down."""
    try:
        if program in PROGRAMS:
            code = importlib.import_module(PROGRAMS[program]).main(words)
        else:
            runpy.run_path(program, run_name="__main__")
            code = 0
    except SystemExit as ended:  # raised by --help
        code = ended.code
    except BaseException:
        traceback.print_exc()
        code = 1
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code or 0)


if __name__ == "__main__":
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()
    given = serve()
    if given is not None:
        finish(*given)
