"""The current itself."""

from __future__ import annotations

from models.network.signals.driven import drive, driven_form
from models.network.signals.kind import SignalKind

KIND = SignalKind(
    name="current",
    title="current in A",
    example="current",
    values=drive,
    settled=drive,
    after_step=drive,
    loop=driven_form,
    as_resistance=True,
)
