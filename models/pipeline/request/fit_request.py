"""What is asked of a fit: the runs, the cell, the structure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

from models.data.timeseries import TimeSeries
from models.identification.progress import Progress
from models.network.structure import Structure


@dataclass(frozen=True, kw_only=True)
class FitRequest:
    """What is asked of a fit.

    Attributes
    ----------
    train : runs that the model is made from
    capacity_Ah : cell capacity
    structure : "auto", "full", "minimal", "bounded", "searched", or a structure of one's own, which is kept
    validate : runs that only judge the result
    initial_soc, validate_soc : fraction at the start of each run; by default its first `soc_ref` and, of a run that
        only judges and has none, what the fitted network says of the rest that it begins with
    initial_soc_std : how far off the stated SoC of a training run may be; it is then estimated with the fit. 0: known
    coulombic_efficiency : share of the charge going in that comes out again
    dt_s : sampling time; by default the typical interval of the training runs
    progress : called with a share 0..1 and a short text
    without : effects that are left out of the bounded network
    finer : effects that it has with more resolution than usual
    code_version : of the program, for the record
    in_step : the runs are as an earlier model reads them, so that no dead time is looked for
    """

    train: list[TimeSeries]
    capacity_Ah: float
    structure: str | Structure = "auto"
    validate: list[TimeSeries] | None = None
    initial_soc: list[float] | None = None
    validate_soc: list[float] | None = None
    initial_soc_std: float = 0.0
    coulombic_efficiency: float = 1.0
    dt_s: float | None = None
    progress: Progress | None = None
    without: tuple[str, ...] = ()
    finer: tuple[str, ...] = ()
    code_version: str = "unknown"
    in_step: bool = False


class FitOptions(TypedDict, total=False):
    """Those fields of a `FitRequest` that have a default."""

    structure: str | Structure
    validate: list[TimeSeries] | None
    initial_soc: list[float] | None
    validate_soc: list[float] | None
    initial_soc_std: float
    coulombic_efficiency: float
    dt_s: float | None
    progress: Progress | None
    without: tuple[str, ...]
    finer: tuple[str, ...]
    code_version: str
    in_step: bool
