"""Where a model comes from: its parent, the data with their hashes, settings, errors and code, as one chain.

Every model document holds its own link in `record.version`; the parent's whole document, version included, enters
the child's hash, so that a chain that has been tampered with does not verify.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork

SCHEMA_VERSION = 1
_COLUMNS = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
_WAYS = ("fit", "refit", "update", "effect")


@dataclass(frozen=True)
class RunIdentity:
    """A run by its content.

    Attributes
    ----------
    name : what a person calls it
    sha256 : of its samples
    n_samples, duration_s : its size
    """

    name: str
    sha256: str
    n_samples: int
    duration_s: float


@dataclass(frozen=True)
class Version:
    """One link of the chain.

    Attributes
    ----------
    number : 1 for a model without parent, else one more than the parent's
    made_by : "fit", "refit", "update" or "effect"
    parent : hash of the parent's document; None for the first
    runs : the data that this version was made from, on top of the parent's
    settings : what was asked for and chosen; plain types
    errors : free-run figures by role, for example "train" and, of the parent on the same runs, "parent"
    code_version : of the program
    sums_sha256 : hash of the stored sums of products that belong to this version, if there are any
    """

    number: int
    made_by: str
    parent: str | None
    runs: tuple[RunIdentity, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    errors: dict[str, Any] = field(default_factory=dict)
    code_version: str = "unknown"
    sums_sha256: str | None = None

    def __post_init__(self) -> None:
        """Check number and kind."""
        if self.made_by not in _WAYS:
            raise ModelError(f"model version: made by {self.made_by!r}; one of {', '.join(_WAYS)} is known")
        if self.number < 1 or (self.number == 1) != (self.parent is None):
            raise ModelError(
                f"model version: number {self.number} {'has no' if self.parent is None else 'has a'} parent; "
                "version 1 has none, every later one has"
            )

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        document = asdict(self)
        return {"schema_version": SCHEMA_VERSION} | document | {"runs": [asdict(run) for run in self.runs]}

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Version:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is no version of this schema, or damaged.
        """
        if not isinstance(document, dict) or document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not a model version of schema version {SCHEMA_VERSION}")
        try:
            fields = {key: value for key, value in document.items() if key != "schema_version"}
            fields["runs"] = tuple(RunIdentity(**run) for run in fields["runs"])
            return cls(**fields)
        except (KeyError, TypeError) as error:
            raise ModelError(f"model version is damaged: {error}") from None


def run_sha256(run: TimeSeries) -> str:
    """Hash of a run's samples, the same on every machine; its name does not enter."""
    digest = hashlib.sha256()
    for key in _COLUMNS:
        values = getattr(run, key)
        if values is None:
            continue
        # Every missing value is the same one, and -0 is 0.
        plain = np.where(np.isnan(values), np.nan, values + 0.0).astype("<f8")
        digest.update(f"{key}:{len(plain)};".encode())
        digest.update(plain.tobytes())
    return digest.hexdigest()


def run_identity(run: TimeSeries) -> RunIdentity:
    """Identify a run by its content."""
    return RunIdentity(run.name, run_sha256(run), len(run), run.duration_s)


def document_sha256(document: dict[str, Any]) -> str:
    """Hash of a JSON document, whatever the order of its keys."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def network_sha256(network: LocalModelNetwork) -> str:
    """Hash of a network's whole document, its version included."""
    # Through text once, so that a network from memory and one from a file are the same.
    return document_sha256(json.loads(json.dumps(network.to_json())))


def version_of(network: LocalModelNetwork) -> Version | None:
    """Return a network's version; None where it has none."""
    document = network.record.version
    return None if document is None else Version.from_json(document)


def with_version(
    network: LocalModelNetwork,
    made_by: str,
    runs: Iterable[TimeSeries],
    *,
    parent: LocalModelNetwork | None = None,
    settings: dict[str, Any] | None = None,
    errors: dict[str, Any] | None = None,
    code_version: str = "unknown",
    sums_sha256: str | None = None,
) -> LocalModelNetwork:
    """Write a network's version into its record.

    Parameters
    ----------
    network : the new model
    made_by : how it was made
    runs : the data it was made from, on top of the parent's
    parent : the model it was made from; one without a version counts as version 1
    settings, errors, code_version, sums_sha256 : as in Version
    """
    before = None if parent is None else version_of(parent)
    version = Version(
        number=1 if parent is None else (before.number if before else 1) + 1,
        made_by=made_by,
        parent=None if parent is None else network_sha256(parent),
        runs=tuple(run_identity(run) for run in runs),
        settings=settings or {},
        errors=errors or {},
        code_version=code_version,
        sums_sha256=sums_sha256,
    )
    return replace(network, record=replace(network.record, version=version.to_json()))


def chain(newest: LocalModelNetwork, known: Iterable[LocalModelNetwork]) -> list[LocalModelNetwork]:
    """Walk from a model to its first ancestor.

    Parameters
    ----------
    newest : where to begin
    known : models among which the ancestors are looked for

    Returns
    -------
    The model, its parent, and so on.

    Raises
    ------
    ModelError
        A parent is not among the known models as it was when the child was made, or the numbers do not fit.
    """
    by_hash = {network_sha256(network): network for network in known}
    found = [newest]
    while (version := version_of(found[-1])) is not None and version.parent is not None:
        parent = by_hash.get(version.parent)
        if parent is None:
            raise ModelError(
                f"model version {version.number}: its parent {version.parent[:12]} is not among the {len(by_hash)} "
                "known models, or it has been changed since"
            )
        before = version_of(parent)
        if version.number != (before.number if before else 1) + 1:
            raise ModelError(f"model version {version.number} follows version {before.number if before else 1}")
        found.append(parent)
    return found


def data_of(models: Iterable[LocalModelNetwork]) -> list[RunIdentity]:
    """All runs that the models of a chain were made from, each once."""
    versions = [version_of(network) for network in models]
    runs = [run for version in versions if version is not None for run in version.runs]
    return list({run.sha256: run for run in runs}.values())
