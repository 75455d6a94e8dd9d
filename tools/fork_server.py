"""Start kernels by forking: one process loads what notebooks import, each kernel is a copy of it.

A kernel that starts from nothing spends two seconds on importing numpy, matplotlib, sympy, numba
and the library, and `make test` starts 140 of them. A copy has its variables, its folder and its
end to itself. (The fork server of `multiprocessing` would import the caller's program into each.)

    python tools/fork_server.py     a line of JSON in (arguments, folder, environment), a process
                                    number out, until the input ends; then its kernels end, too
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import json
import os
import signal
import subprocess
import sys
import threading
from typing import Any

from jupyter_client.connect import KernelConnectionInfo
from jupyter_client.provisioning import LocalProvisioner

LOADED = """
    filterpy.kalman ipykernel.kernelapp ipywidgets matplotlib.backends.backend_agg
    matplotlib.pyplot scipy.optimize scipy.sparse.linalg scipy.stats sympy slamlab.datasets
    slamlab.evaluation.tours slamlab.exercises.labs slamlab.plots slamlab.widgets
""".split()


def load() -> None:
    """Import what notebooks import, and let numba settle, where it is installed."""
    for name in LOADED:
        with contextlib.suppress(ImportError):  # the notebook that needs it will say so
            importlib.import_module(name)
    with contextlib.suppress(ImportError):
        importlib.import_module("numba").njit(lambda x: x)(0)
    # What is loaded stays: no kernel need look through it for garbage.
    gc.collect()
    gc.freeze()


def serve() -> None:
    """Fork a kernel for each line that comes."""
    load()
    requests, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 0)
    os.dup2(nowhere, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody asks how a kernel ended
    for line in requests:
        child = os.fork()
        if not child:
            requests.close()
            answers.close()
            be_kernel(*json.loads(line))
        print(child, file=answers, flush=True)


def be_kernel(arguments: list[str], folder: str, environment: dict[str, str]) -> None:
    """Do what `python -m ipykernel_launcher ARGUMENTS` does when it is started in a folder."""
    from ipykernel import kernelapp

    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    kernelapp.launch_new_instance(argv=arguments, parent_handle=os.getppid())
    atexit._run_exitfuncs()
    os._exit(0)  # to clear away what was loaded takes as long as a small notebook


ASKING = threading.Lock()


@functools.cache
def server(environment: frozenset[tuple[str, str]]) -> subprocess.Popen[str]:
    """Return the process that forks kernels in an environment."""
    return subprocess.Popen(
        [sys.executable, __file__],
        env=dict(environment),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


class Fork:
    """As much of a Popen as the provisioner asks for, of a process that is no child of ours."""

    stdin = stdout = stderr = None

    def __init__(self, arguments: list[str], folder: str, environment: dict[str, str]):
        request = json.dumps([arguments, folder, environment])
        # How to draw is settled when matplotlib is imported.
        loading = environment | {"MPLBACKEND": "module://matplotlib_inline.backend_inline"}
        # What only the kernel reads when it starts: else each had a server that never ends.
        for name in ("PYTEST_CURRENT_TEST", "IPYTHONDIR", "SLAMLAB_SEED_SHIFT"):
            loading.pop(name, None)
        with ASKING:
            process = server(frozenset(loading.items()))
            assert process.stdin is not None
            assert process.stdout is not None
            print(request, file=process.stdin, flush=True)
            answer = process.stdout.readline()
        if not answer:
            raise RuntimeError("the process that forks kernels has ended")
        self.pid = int(answer)

    def poll(self) -> int | None:
        """Return None as long as it runs."""
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return 0
        return None

    wait = poll  # asked for when poll has said that it ended

    def send_signal(self, number: int) -> None:
        """Send it a signal; one that has ended gets none."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)


class ForkProvisioner(LocalProvisioner):
    """Forks kernels instead of starting a Python for each."""

    async def launch_kernel(self, cmd: list[str], **kwargs: Any) -> KernelConnectionInfo:
        """Start the kernel that a command names."""
        arguments = cmd[cmd.index("ipykernel_launcher") + 1 :]
        self.process = Fork(arguments, kwargs.get("cwd") or os.getcwd(), kwargs["env"])
        self.pid = self.pgid = self.process.pid
        return self.connection_info


if __name__ == "__main__":
    del sys.path[0]  # this folder: a kernel starts with the notebook's in its place
    serve()
