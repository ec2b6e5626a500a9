"""Where a run starts: what the user says, else the run's own reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from argparse import Namespace

    from models.data.timeseries import TimeSeries
    from models.module.network import ModuleNetwork
    from models.network.local_model_network import LocalModelNetwork

    Model = LocalModelNetwork | ModuleNetwork


# Anywhere between empty and full is as likely: the standard deviation of that is 0.29.
_GUESS = (0.5, 0.29)


def initial_soc(
    runs: Sequence[TimeSeries],
    given: Sequence[float] | None,
    network: Model | None = None,
    output: Output | None = None,
    option: str = "--initial-soc",
) -> list[float]:
    """Return the SoC at the start of each run: `option`, else the run's first `soc_ref`, else by a rest.

    With a model, a run that begins with a sufficient rest starts where its open-circuit voltage says.

    Raises
    ------
    UsageError
        The option has neither one value nor one for each run.
    ModelError
        A run has no reference and the option is absent.
    """
    # Lazy: numpy takes 60 ms.
    from models.data.start_soc import start_soc

    if given is None and network is not None:
        return [soc for soc, _ in known_starts(runs, given, network, output)]
    if given is None:
        return [start_soc(run) for run in runs]
    if len(given) not in (1, len(runs)):
        wanted = "1 value" if len(runs) == 1 else f"1 value or {len(runs)}"
        raise UsageError(f"{option} has {len(given)} values for {len(runs)} run(s); give {wanted}")
    return list(given) if len(given) == len(runs) else [given[0]] * len(runs)


def starts_apart(
    train: Sequence[TimeSeries],
    judged: Sequence[TimeSeries],
    options: Namespace,
    network: LocalModelNetwork,
    output: Output,
) -> tuple[list[float], list[float]]:
    """Return the SoC at the start of runs to learn from, and of those that judge.

    `--initial-soc` alone, with one value or one for every run, speaks of all of them, those to learn from first.
    """
    given, every = options.initial_soc, [*train, *judged]
    if given is not None and options.train_initial_soc is None and len(given) in (1, len(every)):
        soc = initial_soc(every, given)
        return soc[: len(train)], soc[len(train) :]
    learned = initial_soc(train, options.train_initial_soc, network, output, "--train-initial-soc")
    return learned, initial_soc(judged, given, network, output)


def stated_apart(
    train: Sequence[TimeSeries], judged: Sequence[TimeSeries], given: Sequence[float] | None
) -> tuple[list[float], list[float] | None]:
    """Return the SoC at the start of runs to fit a model to, and of those that judge it.

    None for these where nothing is given: a rest may tell it, once there is a model; see `judged_starts`.
    """
    if given is None:
        return initial_soc(train, None), None
    soc = initial_soc([*train, *judged], given)
    return soc[: len(train)], soc[len(train) :]


def judged_starts(runs: Sequence[Mapping[str, Any]], output: Output) -> list[float]:
    """Return where a fit has taken the runs that judge it to start, of its figures; says which by a rest."""
    for each in runs:
        _tell_rest(each["run"], each["initial_soc"]["value"], each["initial_soc"]["std"], output)
    return [each["initial_soc"]["value"] for each in runs]


def known_starts(
    runs: Sequence[TimeSeries], given: Sequence[float] | None, network: Model, output: Output | None
) -> list[tuple[float, float | None]]:
    """Return the same with its standard deviation where it was read from a rest; else None: it is somebody's word."""
    if given is not None:
        return [(soc, None) for soc in initial_soc(runs, given)]
    return [_known_soc(run, network, output) for run in runs]


def guessed_soc(
    runs: Sequence[TimeSeries], given: Sequence[float] | None, network: Model, output: Output
) -> list[tuple[float, float | None]]:
    """Return where an observer starts in each run, with the standard deviation where it is a mere guess."""
    # Lazy: numpy takes 60 ms.
    from models.data.errors import ModelError

    if given is not None:
        return [(soc, None) for soc in initial_soc(runs, given)]
    starts: list[tuple[float, float | None]] = []
    for run in runs:
        try:
            starts.append(_known_soc(run, network, output))
        except ModelError:
            output.warn(f"{run.name}: no soc_ref, no rest, no --initial-soc: the observer starts at {_GUESS[0]:g}")
            starts.append(_GUESS)
    return starts


def _known_soc(run: TimeSeries, network: Model, output: Output | None) -> tuple[float, float | None]:
    """SoC from the run's reference, else from the rest that it begins with and then with its standard deviation."""
    # Lazy: numba and scipy take 930 ms.
    from models.module.network import ModuleNetwork
    from models.readouts.rest_start import known_start

    module = isinstance(network, ModuleNetwork)
    seen, cell = (network.mean_cell_series(run), network.network) if module else (run, network)
    soc, std = known_start(seen, cell)
    if output is not None:
        _tell_rest(run.name, soc, std, output)
    return soc, std


def _tell_rest(name: str, soc: float, std: float | None, output: Output) -> None:
    if std is not None:
        output.warn(f"{name}: SoC at its start from the open-circuit voltage after a rest: {soc:.3f} +- {std:.3f}")
