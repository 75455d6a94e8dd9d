"""Kernels that start as forks are kernels like others."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tools.fork_server import Fork
from tools.kernels import LocalKernelManager

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no kernel is a fork")
ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """Two kernels, started in two folders, and what they say to a piece of code."""
    managers = []
    for number in range(2):
        managers.append(LocalKernelManager())
        managers[-1].start_kernel(cwd=str(tmp_path_factory.mktemp(f"folder{number}")))
    clients = [manager.blocking_client() for manager in managers]
    for client in clients:
        client.start_channels()
        client.wait_for_ready(timeout=60)
    yield [(manager, Say(client)) for manager, client in zip(managers, clients, strict=True)]
    for manager, client in zip(managers, clients, strict=True):
        client.stop_channels()
        manager.shutdown_kernel()


class Say:
    """Runs code; returns what it printed, or the name of its error."""

    def __init__(self, client):
        self.client = client

    def __call__(self, code):
        said = []

        def hear(message):
            content = message["content"]
            said.append(content.get("text") or content.get("ename") or "")

        self.client.execute_interactive(code, timeout=60, output_hook=hear, allow_stdin=False)
        return "".join(said)


def gone(pid, seconds=10.0):
    """Whether a process ends in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_a_kernel_finds_everything_loaded_and_starts_with_nothing(kernels):
    for manager, say in kernels:
        assert isinstance(manager.provisioner.process, Fork)
        found = "import sys; print('sympy' in sys.modules, 'np' in globals())"
        assert say(found) == "True False\n"


def test_kernels_share_no_variables_and_no_folder(kernels):
    (_, one), (_, other) = kernels
    one("import slamlab, os; slamlab.mine = 1; mine = 2; os.environ['MINE'] = 'x'")
    other("import slamlab, os")
    assert one("print(slamlab.mine, mine, os.environ['MINE'])") == "1 2 x\n"
    found = "print(hasattr(slamlab, 'mine'), 'mine' in globals(), 'MINE' in os.environ)"
    assert other(found) == "False False False\n"
    where = [say("print(os.path.basename(os.getcwd()))") for _, say in kernels]
    assert [name[:7] for name in where] == ["folder0", "folder1"]


def test_a_module_of_the_folder_is_found_and_none_of_the_tools(kernels):
    _, say = kernels[0]
    say("from pathlib import Path; Path('beside.py').write_text('x = 7')")
    assert say("import beside; print(beside.x)") == "7\n"
    assert say("import fork_server") == "ModuleNotFoundError"


def test_a_figure_is_drawn_in_line(kernels):
    _, say = kernels[0]
    assert say("import matplotlib; print(matplotlib.get_backend())").strip().endswith("inline")


def test_a_program_that_a_cell_starts_tells_how_it_ended(kernels):
    _, say = kernels[0]
    code = "import subprocess, sys; print(subprocess.call([sys.executable, '-c', 'exit(3)']))"
    assert say(code) == "3\n"


def test_a_cell_can_be_interrupted(kernels):
    manager, say = kernels[0]
    timer = threading.Timer(0.5, manager.interrupt_kernel)
    timer.start()
    assert say("import time; time.sleep(30)") == "KeyboardInterrupt"
    timer.join()


def test_a_kernel_ends_when_it_is_shut_down_or_dies():
    for kill in (False, True):
        manager = LocalKernelManager()
        manager.start_kernel()
        pid = manager.provisioner.process.pid
        assert manager.is_alive()
        if kill:
            os.kill(pid, signal.SIGKILL)
        else:
            manager.shutdown_kernel()
        assert gone(pid)
        assert not manager.is_alive()
        manager.shutdown_kernel(now=True)  # a signal to what is gone is no error


ABANDONED = """
import os
from tools.kernels import LocalKernelManager
manager = LocalKernelManager()
manager.start_kernel()
client = manager.blocking_client()
client.start_channels()
client.wait_for_ready(timeout=60)
print(manager.provisioner.process.pid, flush=True)
os._exit(0)
"""


def test_kernels_end_with_who_started_them():
    done = subprocess.run(
        [sys.executable, "-c", ABANDONED], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert gone(int(done.stdout))
