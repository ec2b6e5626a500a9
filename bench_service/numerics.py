"""How the numerical libraries of this process, and of those that it starts, go about their work."""

from __future__ import annotations

import os

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread() -> None:
    """Let numerical libraries work in one thread each, unless somebody has said otherwise; before they are imported.

    A model's equations are small: on a machine that has other work their threads wait for each other most of the time.
    """
    for name in _VARIABLES:
        os.environ.setdefault(name, "1")
