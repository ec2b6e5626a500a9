"""Every limit is kept whatever is asked for; what cannot be is refused with the limits in conflict."""

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from models.design.constraints.feasible import Feasible
from models.design.constraints.limits import InfeasibleError, Limits
from models.design.design import design
from models.design.optimise.block_design import DesignRequest, demands_of
from tests.unit.models.design.networks import experiment, resistive

CAPACITY_AH, DT_S = 2.0, 10.0


@st.composite
def requests(draw: st.DrawFn) -> tuple[float, DesignRequest]:
    start = draw(st.floats(0.25, 0.75))
    soc = (start - draw(st.floats(0.1, 0.25)), start + draw(st.floats(0.1, 0.25)))
    current = (-draw(st.floats(1.0, 6.0)), draw(st.floats(1.0, 6.0)))
    # At rest 3.3 V + 0.5 V times the state of charge.
    voltage = draw(st.none() | st.tuples(st.floats(3.0, 3.4), st.floats(3.7, 4.0)))
    ramp = draw(st.none() | st.tuples(st.floats(-1.0, -0.05), st.floats(0.05, 1.0)))
    levels = draw(st.sampled_from(((), (0.25, 0.75), (0.2, 0.4, 0.6, 0.8))))
    spread = tuple(soc[0] + share * (soc[1] - soc[0]) for share in levels)
    net = draw(st.none() | st.just((-0.05, 0.05))) if not levels else None
    limits = Limits(current, soc, voltage_V=voltage, ramp_A_per_s=ramp, net_charge_Ah=net)
    signal = draw(st.sampled_from(("optimal", "optimal", "aprbs", "hppc")))
    duration_s = draw(st.floats(3000.0, 12_000.0))
    return start, DesignRequest(limits, duration_s, signal=signal, soc_levels=spread, n_starts=1, seed=1)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(asked=requests(), order=st.sampled_from((0, 1)))
def test_every_limit_is_kept(asked: tuple[float, DesignRequest], order: int) -> None:
    (start, request), limits = asked, asked[1].limits
    where = experiment(network=resistive(order), initial_soc=start)
    try:
        found = design(where, request)
    except InfeasibleError as error:
        assert str(error)
        return
    current = found.current_A
    assert limits.current_A[0] - 1e-8 <= current.min() and current.max() <= limits.current_A[1] + 1e-8
    soc = start + np.cumsum(current) * DT_S / 3600.0 / CAPACITY_AH
    assert limits.soc[0] - 1e-8 <= soc.min() and soc.max() <= limits.soc[1] + 1e-8
    np.testing.assert_allclose(found.coverage.soc, (soc.min(), soc.max()), atol=1e-9)
    if limits.ramp_A_per_s is not None:
        steps = np.diff(np.concatenate([[0.0], current, [0.0]])) / DT_S
        assert limits.ramp_A_per_s[0] - 1e-8 <= steps.min() and steps.max() <= limits.ramp_A_per_s[1] + 1e-8
    if limits.net_charge_Ah is not None:
        assert abs(current.sum()) * DT_S / 3600.0 <= 0.05 + 1e-8
    if limits.voltage_V is not None:
        low, high = Feasible(where, demands_of(where, limits), len(current)).voltage_band_V(current)
        assert limits.voltage_V[0] <= low.min() and high.max() <= limits.voltage_V[1]
