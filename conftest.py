"""nbval starts kernels without TCP ports (see tools/kernels.py); less garbage is looked for."""

import gc
import sys

# Where notebooks are run: pytest has loaded nbval then, and other tests leave it alone.
if "nbval.plugin" in sys.modules:
    from tools.kernels import settle_nbval

    settle_nbval()


def pytest_collection_finish() -> None:
    """Spare Python from looking for garbage among thousands of tests that stay to the end."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)
