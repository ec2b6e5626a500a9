"""RO-Crate 1.1 bundles: files with their hashes in a zip, and what they are and come from as JSON-LD beside them.

After https://www.researchobject.org/ro-crate/1.1/. Equal content gives equal bytes.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

SUFFIX, MEDIA_TYPE = ".crate.zip", "application/zip"
METADATA = "ro-crate-metadata.json"
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
_FIRST_DAY = (1980, 1, 1, 0, 0, 0)  # of a zip; every file of a crate bears it, so that equal crates are equal

Entity = dict[str, Any]


@dataclass(frozen=True, slots=True)
class CrateFile:
    """A file of a crate.

    Attributes
    ----------
    path : where it lies in the crate, with ``/``
    content : its bytes
    media_type : for readers
    told : further properties of its entity, such as ``name`` and ``description``
    """

    path: str
    content: bytes
    media_type: str
    told: Mapping[str, Any] = field(default_factory=dict)

    @property
    def entity(self) -> Entity:
        """What the metadata say of it."""
        return {
            "@id": self.path,
            "@type": "File",
            "encodingFormat": self.media_type,
            "contentSize": str(len(self.content)),
            "sha256": hashlib.sha256(self.content).hexdigest(),
            **self.told,
        }


def json_file(path: str, document: Any, **told: Any) -> CrateFile:
    """Return a JSON document as a file of a crate."""
    content = json.dumps(document, indent=1, sort_keys=True, allow_nan=False).encode()
    return CrateFile(path, content, "application/json", told)


def encode_crate(root: Mapping[str, Any], files: Sequence[CrateFile], entities: Sequence[Entity]) -> bytes:
    """Return a crate as the bytes of a zip.

    Parameters
    ----------
    root : properties of the whole: at least ``name``, ``description``, ``datePublished``, ``license``
    files : in the order in which they are listed; each path once
    entities : people, devices, cells, and the actions that have made the files

    Raises
    ------
    ValueError
        A path twice, or a property that the specification asks for is missing.
    """
    paths = [each.path for each in files]
    if len(set(paths)) != len(paths):
        raise ValueError(f"a path stands twice in a crate: {sorted(paths)}")
    if missing := {"name", "description", "datePublished", "license"} - set(root):
        raise ValueError(f"a crate must say its {', '.join(sorted(missing))}")
    descriptor = {
        "@id": METADATA,
        "@type": "CreativeWork",
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        "about": {"@id": "./"},
    }
    whole = {"@id": "./", "@type": "Dataset", "hasPart": [{"@id": path} for path in paths], **root}
    graph = [_compact(each) for each in (descriptor, whole, *(each.entity for each in files), *entities)]
    metadata = json.dumps({"@context": _CONTEXT, "@graph": graph}, indent=1, allow_nan=False).encode()
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as bundle:
        for path, content in [(METADATA, metadata), *((each.path, each.content) for each in files)]:
            entry = zipfile.ZipInfo(path, _FIRST_DAY)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            bundle.writestr(entry, content)
    return sink.getvalue()


def _compact(entity: Entity) -> Entity:
    """Write one value as itself and none not at all, as the specification recommends."""
    lists = {name: value for name, value in entity.items() if isinstance(value, list) and len(value) < 2}
    kept = {name: value for name, value in entity.items() if name not in lists}
    return kept | {name: value[0] for name, value in lists.items() if value}
