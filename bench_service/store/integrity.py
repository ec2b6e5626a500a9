"""Whether what is read of a run is all of it, and the very samples that were stored.

A reader alone cannot tell: a file of samples that is empty, or older than the run, reads well. The run's record says
how many samples there were and what they hash to; here the two are held against each other.
"""

from dataclasses import dataclass

from bench_service.errors import DamagedError
from bench_service.store.reading import StreamData
from bench_service.store.records import OPEN_RUN_STATES, RunRecord
from bench_service.store.samples import SampleReader
from bench_service.streams import SAMPLES, content_hash

REMEDY = "restore a backup, or see 'bench-service verify'"
_MOST_TOLD = 3


@dataclass(frozen=True, slots=True)
class Expected:
    """What must be there of a run's samples.

    Attributes
    ----------
    run_id : str
    n_samples : int or None
        None while the run goes on.
    sha256 : str or None
        Content hash; None where the recorder could not give one. Then `n_samples` were acknowledged, and some that were
        on their way may be stored too.
    loss : str or None
        What a repair has found lost; count and hash are then those of the rest.
    """

    run_id: str
    n_samples: int | None = None
    sha256: str | None = None
    loss: str | None = None

    @classmethod
    def of(cls, run: RunRecord) -> "Expected":
        """Return what a run's record promises."""
        if run.state in OPEN_RUN_STATES:
            return cls(run.id)
        return cls(run.id, run.n_samples, run.sha256, None if run.repaired_utc is None else run.damage)


def damage_of(expected: Expected, data: StreamData) -> str | None:
    """Say what is wrong with all the samples of a run as they were read; None where nothing is."""
    if data.damaged or (data.gaps and expected.loss is None):
        return _gaps_in_words(data)
    if (missing := _missing(expected, data.n)) is not None:
        return missing
    if expected.sha256 is not None and content_hash(data.columns) != expected.sha256:
        return f"the {data.n} stored samples are not those that were recorded: their hash is another"
    return expected.loss


def read_whole(reader: SampleReader, expected: Expected) -> StreamData:
    """Return all samples of a run.

    Raises
    ------
    DamagedError
        Some are missing, damaged, or not those that were recorded.
    StoreError
        The file cannot be read at all.
    """
    data = reader.read(expected.run_id)
    if (damage := damage_of(expected, data)) is not None:
        raise damaged(expected.run_id, damage)
    return data


def read_part(
    reader: SampleReader, expected: Expected, stream: str, from_s: float | None, to_s: float | None
) -> tuple[StreamData, str | None]:
    """Return rows of a stream, and what is wrong with them or with the run that they belong to."""
    data = reader.read(expected.run_id, stream, from_s, to_s)
    whole = stream == SAMPLES and from_s is None and to_s is None
    return data, damage_of(expected, data) if whole else damage_beside(reader, expected, data)


def damage_beside(reader: SampleReader, expected: Expected, part: StreamData) -> str | None:
    """Say what is wrong with rows that are not all the samples of a run, or with the run that they belong to."""
    if part.gaps and expected.loss is None:
        return _gaps_in_words(part)
    if expected.n_samples is None:
        return None
    return _missing(expected, reader.n_rows(expected.run_id)) or expected.loss


def damaged(run_id: str, damage: str) -> DamagedError:
    """Return the error for a run whose samples are damaged."""
    return DamagedError(f"run {run_id} is damaged: {damage}; {REMEDY}", ("run", run_id))


def count_damage(run: RunRecord, stored: int) -> str | None:
    """Say whether so many stored samples are not as many as a run's record promises; None where they are."""
    return _missing(Expected.of(run), stored)


def _missing(expected: Expected, stored: int) -> str | None:
    if expected.n_samples is None or stored == expected.n_samples:
        return None
    if expected.sha256 is None and stored > expected.n_samples:
        return None
    return f"{stored} of {expected.n_samples} samples are stored"


def _gaps_in_words(data: StreamData) -> str:
    lost = sum(gap.n for gap in data.gaps)
    told = [f"rows {gap.seq0} to {gap.seq0 + gap.n - 1}: {gap.reason}" for gap in data.gaps[:_MOST_TOLD]]
    more = f" and {len(data.gaps) - _MOST_TOLD} more places" if len(data.gaps) > _MOST_TOLD else ""
    return f"{lost} of {data.n + lost} samples cannot be read ({'; '.join(told)}{more})"
