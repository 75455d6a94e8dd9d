"""nbval starts kernels without TCP ports and says what came on stderr: see tools/kernels.py."""

import contextlib

with contextlib.suppress(ImportError):  # a student has pytest perhaps, but no nbval
    import nbval.kernel
    from nbval.plugin import IPyNbCell

    from tools.kernels import LocalKernelManager, saying_stderr

    nbval.kernel.KernelManager = LocalKernelManager
    IPyNbCell.compare_outputs = saying_stderr(IPyNbCell.compare_outputs)
