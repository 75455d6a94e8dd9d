"""Kernels that talk over files of their own: no two of them can reach for one port.

By default a kernel is told five TCP ports that were free a moment before; with two kernels
starting at once, one of them may find a port taken. Under IPC the sockets are files in a folder
that belongs to one kernel alone. Windows has no such sockets and keeps TCP.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile

from jupyter_client.manager import AsyncKernelManager, KernelManager


def socket_path() -> str:
    """Path stem, in a new folder, for the socket files of one kernel."""
    folder = tempfile.mkdtemp(prefix="kernel-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return os.path.join(folder, "socket")


def options() -> dict[str, str]:
    """Return what a new kernel manager is told about its transport."""
    return {} if os.name == "nt" else {"transport": "ipc", "ip": socket_path()}


class LocalKernelManager(KernelManager):
    """A kernel manager on IPC."""

    def __init__(self, **kwargs):
        super().__init__(**options() | kwargs)


class LocalAsyncKernelManager(AsyncKernelManager):
    """The same for nbclient."""

    def __init__(self, **kwargs):
        super().__init__(**options() | kwargs)
