"""Runs that are held against what is known of a cell: the options that name them, and what they come to."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.cli.arguments import fraction, fractions
from bench_service.cli.files import add_current_sign, read_model, read_runs
from bench_service.cli.initial_soc import initial_soc
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.network.local_model_network import LocalModelNetwork

_RUNS_HELP = "CSV, gzipped CSV or Parquet"


@dataclass(frozen=True, slots=True)
class JudgedRuns:
    """What the options name.

    Attributes
    ----------
    network : the model
    runs, soc : to be judged, with their SoC at the start
    soc_std : its standard deviations; None: those of a careful statement
    train, train_soc : what the model was made from; None where it was not named
    """

    network: LocalModelNetwork
    runs: list[TimeSeries]
    soc: list[float]
    soc_std: list[float] | None
    train: list[TimeSeries] | None
    train_soc: list[float] | None


def add_judged_runs(
    parser: ArgumentParser, *, model_help: str | None = None, in_order: bool = False, soc_help: str = ""
) -> None:
    """Add the options.

    Parameters
    ----------
    parser : of the command
    model_help : what the model is, where that needs a word
    in_order : the runs are a series in time
    soc_help : what else is to be said of the SoC
    """
    parser.add_argument("model", type=Path, metavar="MODEL.json", help=model_help)
    order = ", in time's order" if in_order else ""
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help=_RUNS_HELP + order)
    parser.add_argument(
        "--train", type=Path, nargs="+", action="extend", default=[], metavar="RUN", help="runs the model was made from"
    )
    parser.add_argument(
        "--initial-soc",
        type=fractions,
        action="extend",
        metavar="S[,S...]",
        help="one value, or one for each RUN" + soc_help,
    )
    parser.add_argument(
        "--train-initial-soc",
        type=fractions,
        action="extend",
        metavar="S[,S...]",
        help="the same for the runs of --train",
    )
    parser.add_argument(
        "--initial-soc-std",
        type=fraction,
        metavar="D",
        help="how far off the SoC of the runs' start may be (default: 0.005, a careful statement)",
    )
    add_current_sign(parser)


def read_judged_runs(options: Namespace, output: Output) -> JudgedRuns:
    """Read what the options name.

    Raises
    ------
    UsageError, RunFileError, ModelError
        A file cannot be read, or nobody says where a run starts.
    """
    network = read_model(options.model)
    runs = read_runs(options.runs, options.current_sign, output)
    train = read_runs(options.train, options.current_sign, output)
    soc = initial_soc(runs, options.initial_soc, network, output)
    train_soc = initial_soc(train, options.train_initial_soc, network, output, "--train-initial-soc")
    std = None if options.initial_soc_std is None else [options.initial_soc_std] * len(runs)
    return JudgedRuns(network, runs, soc, std, train or None, train_soc or None)
