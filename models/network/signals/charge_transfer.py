"""Charge transfer: asinh of the current over the exchange current, with symmetric transfer.

Newman and Thomas-Alyea, "Electrochemical Systems", 2004, ch. 8.
"""

from __future__ import annotations

from dataclasses import replace

from models.network.signals.driven import (
    ACTIVATION,
    EXCHANGE_CURRENT,
    TIME_CONSTANT,
    drive,
    driven,
    driven_after_step,
    driven_form,
)
from models.network.signals.kind import SignalKind

KIND = SignalKind(
    name="charge_transfer",
    title="asinh of the current over an exchange current, scaled by temperature and low-passed where asked",
    example="charge_transfer:3/2500/20",
    parameters=(EXCHANGE_CURRENT, replace(ACTIVATION, optional=True), replace(TIME_CONSTANT, optional=True)),
    values=driven,
    settled=drive,
    after_step=driven_after_step,
    loop=driven_form,
    as_resistance=True,
)
