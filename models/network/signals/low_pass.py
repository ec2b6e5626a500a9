"""Low-passed current: what flows through the resistor of an RC pair."""

from __future__ import annotations

from dataclasses import replace

from models.network.signals.driven import ACTIVATION, TIME_CONSTANT, drive, driven, driven_after_step, driven_form
from models.network.signals.kind import SignalKind

KIND = SignalKind(
    name="low_pass",
    title="low-passed current in A, scaled by temperature where asked",
    example="low_pass:60/3000",
    parameters=(TIME_CONSTANT, replace(ACTIVATION, optional=True)),
    values=driven,
    settled=drive,
    after_step=driven_after_step,
    loop=driven_form,
    as_resistance=True,
)
