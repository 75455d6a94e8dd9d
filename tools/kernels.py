"""Kernels that talk over files of their own, and start as forks; and what nbval says.

By default a kernel is told five TCP ports that were free a moment before; with two kernels
starting at once, one of them may find a port taken. Under IPC the sockets are files in a folder
that belongs to one kernel alone. Windows has no such sockets and keeps TCP; there, and on a Mac,
where libraries do not survive a fork, each kernel starts from nothing.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
import uuid
from collections.abc import Callable
from typing import Any

from jupyter_client.manager import AsyncKernelManager, KernelManager

from tools.fork_server import ForkProvisioner


def find_fonts() -> None:
    """Let matplotlib list the machine's fonts now; in a cell it would say so, and once only."""
    import matplotlib.font_manager  # noqa: F401


def socket_path() -> str:
    """Path stem, in a new folder, for the socket files of one kernel."""
    folder = tempfile.mkdtemp(prefix="kernel-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return os.path.join(folder, "socket")


def options() -> dict[str, str]:
    """Return what a new kernel manager is told about its transport."""
    return {} if os.name == "nt" else {"transport": "ipc", "ip": socket_path()}


class _Local:
    """What managers of our kernels have in common."""

    def __init__(self, **kwargs):
        super().__init__(**options() | kwargs)
        if sys.platform == "linux":
            self.kernel_id = str(uuid.uuid4())
            self.provisioner = ForkProvisioner(
                parent=self, kernel_id=self.kernel_id, kernel_spec=self.kernel_spec
            )


class LocalKernelManager(_Local, KernelManager):
    """A kernel manager on IPC."""


class LocalAsyncKernelManager(_Local, AsyncKernelManager):
    """The same for nbclient."""


def saying_stderr(compare: Callable[..., bool]) -> Callable[..., bool]:
    """Wrap nbval's comparison: of text on stderr that nobody expected, it says the text."""

    def compare_outputs(self: Any, test: list[Any], ref: list[Any], *rest: Any) -> bool:
        same = compare(self, test, ref, *rest)
        said = "".join(output["text"] for output in test if output.get("name") == "stderr")
        if said and not same:
            self.comparison_traceback.append(f"on stderr: {said}")
        return same

    return compare_outputs


def settle_nbval() -> None:
    """Let nbval start kernels that share no port, and say what came on stderr."""
    import nbval.kernel
    from nbval.plugin import IPyNbCell

    nbval.kernel.KernelManager = LocalKernelManager
    IPyNbCell.compare_outputs = saying_stderr(IPyNbCell.compare_outputs)
