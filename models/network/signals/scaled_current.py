"""Current scaled by temperature as a thermally activated resistance is (Arrhenius)."""

from __future__ import annotations

from models.network.signals.driven import ACTIVATION, drive, driven_form
from models.network.signals.kind import SignalKind

KIND = SignalKind(
    name="scaled_current",
    title="current in A, scaled by temperature",
    example="scaled_current:2500",
    parameters=(ACTIVATION,),
    values=drive,
    settled=drive,
    after_step=drive,
    loop=driven_form,
    as_resistance=True,
)
