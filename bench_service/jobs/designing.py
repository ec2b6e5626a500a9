"""What worker processes do with designs; arguments and results are plain data, the samples they read themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.jobs.modelling import plain
from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import DesignResult, Document
from bench_service.jobs.series import RunInput, read_series
from bench_service.reports.document import Heading, render

if TYPE_CHECKING:
    from models.design.answer import Answer


def design_profile(
    report: Reporter,
    data_dir: Path,
    request: Mapping[str, Any],
    document: Document | None,
    runs: Sequence[RunInput],
    cycle: tuple[list[float], list[float]] | None,
    rivals: Sequence[Document | str] = (),
    heading: Heading | None = None,
) -> DesignResult:
    """Design the profile that a request asks for.

    Parameters
    ----------
    request : mapping
        Keys of the public contract, checked before.
    document : dict or None
        MODEL.json of the reference model.
    runs : sequence of RunInput
        Stored runs that a first reference model is fitted to, where there is no model.
    cycle : times in s and currents in A, or None
        Recorded load cycle, forward hold.
    rivals : sequence of dict or str
        MODEL.json or the name of an effect, of each model that the test is to tell apart.

    heading : Heading or None
        Of the report; None: none is wanted.

    Returns
    -------
    dict
        ``time_s`` and ``current_A`` of the profile, ``figures``: the ``design`` object of the public contract without
        the profile's name, and ``page``: its report.
    """
    # Lazy: numba and scipy take 1.1 s.
    import numpy as np

    from models.design.answer import Material, answer, even_cycle
    from models.design.request import read_request
    from models.network.local_model_network import LocalModelNetwork

    report(0.0, "reading")
    cycle_A, cycle_dt_s = (None, 1.0) if cycle is None else even_cycle(np.array(cycle[0]), np.array(cycle[1]))
    material = Material(
        network=None if document is None else LocalModelNetwork.from_json(document),
        runs=tuple(read_series(data_dir, runs)),
        runs_soc=tuple(run.initial_soc for run in runs),
        cycle_A=cycle_A,
        cycle_dt_s=cycle_dt_s,
        rivals=tuple(each if isinstance(each, str) else LocalModelNetwork.from_json(each) for each in rivals),
    )
    found = answer(read_request(request), material, report)
    profile = found.profile
    page = None if heading is None else _page(heading, found)
    told = {"time_s": profile.time_s, "current_A": profile.current_A, "figures": found.figures}
    return plain(told) | {"page": page}


def _page(heading: Heading, found: Answer) -> bytes:
    # Lazy: numba and scipy take 1.1 s.
    from bench_service.reports.design import design_report

    return render(design_report(heading, found))
