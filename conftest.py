"""nbval starts kernels without TCP ports and says what came on stderr: see tools/kernels.py."""

import contextlib
import gc

with contextlib.suppress(ImportError):  # a student has pytest perhaps, but no nbval
    import nbval.kernel
    from nbval.plugin import IPyNbCell

    from tools.kernels import LocalKernelManager, saying_stderr

    nbval.kernel.KernelManager = LocalKernelManager
    IPyNbCell.compare_outputs = saying_stderr(IPyNbCell.compare_outputs)


def pytest_collection_finish() -> None:
    """Spare Python from looking for garbage among thousands of tests that stay to the end."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)
