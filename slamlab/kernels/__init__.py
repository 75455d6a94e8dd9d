"""Compiled twins of what the systems show: arrays in, arrays out; NumPy and numba only.

The plain function stands in the file of its system and says with `compiled` where its twin is.
The twin serves where numba can be imported, the plain function elsewhere; tests hold both equal.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from typing import Any, TypeVar

__all__ = ["TWINS", "compiled", "numba_serves"]

Plain = TypeVar("Plain", bound=Callable[..., Any])

# Plain functions by the name of their compiled twin, as "occupancy.insert_scan".
TWINS: dict[str, Callable[..., Any]] = {}
_SAID: list[str] = []


def compiled(name: str) -> Callable[[Plain], Plain]:
    """Let the kernel `name` ("module.function") serve for the plain function that follows.

    The kernel takes the same arguments and answers the same. `plain` of the result is the plain
    function itself; it serves where numba is not installed, which is said once a process.

    """

    def decorate(plain: Plain) -> Plain:
        TWINS[name] = plain

        @wraps(plain)
        def serve(*args: Any, **kwargs: Any) -> Any:
            if numba_serves():
                return kernel_of(name)(*args, **kwargs)
            say_that_plain_code_serves()
            return plain(*args, **kwargs)

        serve.plain = plain  # type: ignore[attr-defined]
        return serve  # type: ignore[return-value]

    return decorate


@cache
def numba_serves() -> bool:
    """Say whether numba can be imported: asked, and imported, at the first call of a kernel.

    The import takes most of a second, which a page that calls no kernel need not wait for.
    """
    return bool(import_module("slamlab.kernels.compiling").COMPILED)


@cache
def kernel_of(name: str) -> Callable[..., Any]:
    """Import a kernel by its name; it is compiled at its first call."""
    module, _, function = name.partition(".")
    kernel: Callable[..., Any] = getattr(import_module(f"slamlab.kernels.{module}"), function)
    return kernel


def say_that_plain_code_serves() -> None:
    """Warn, once a process, that numba is missing."""
    if not _SAID:
        _SAID.append("said")
        warnings.warn(
            "numba is not installed: plain NumPy serves, more slowly; "
            "pip install slamlab-course[fast]",
            UserWarning,
            stacklevel=4,
        )
