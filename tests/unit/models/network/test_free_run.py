from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.network.blocked_free_run import blocked_free_run_V, runs_in_blocks
from models.network.compiled_network import flat_network, step_output, step_signals
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import free_run
from models.network.regression import CellContext
from tests.unit.models.hand_network import DT_S, everything, hats

# Seen through Any: the type checker takes the compiled functions' arguments for what they are without compilation.
_STEP_SIGNALS: Any = step_signals
_STEP_OUTPUT: Any = step_output
# More than two blocks.
N = 9000


def measured_run(n: int = N, seed: int = 0, starts: tuple[int, ...] = (0,), largest_A: float = 5.0) -> GridRun:
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-largest_A, largest_A, n // 10 + 1), 10)[:n]
    voltage = 3.6 + 0.05 * rng.standard_normal(n)
    return GridRun(
        name="run",
        dt_s=DT_S,
        time_s=DT_S * np.arange(n),
        current_A=current,
        voltage_V=voltage,
        temperature_degC=20.0 + 12.0 * np.sin(np.arange(n) / 700.0),
        ambient_degC=None,
        charge_Ah=np.concatenate([[0.0], np.cumsum(current[1:])]) / 3600.0,
        soc_ref=None,
        segment_starts=starts,
        measured=np.ones(n, bool),
    )


def on_arrays_V(network: LocalModelNetwork, run: GridRun, soc: float) -> np.ndarray:
    """The free run on the arrays of a regression."""
    data = network.dataset([run], [soc])
    validity = network.partition.validity(data.z)
    return network.to_volts(free_run(network.theta, network.structure.output_order, validity, data))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_blocks_give_the_same_as_the_arrays_of_a_regression(order: int) -> None:
    network, run = everything(order), measured_run()
    assert runs_in_blocks(network, run)
    expected = on_arrays_V(network, run, 0.5)
    np.testing.assert_allclose(blocked_free_run_V(network, run, 0.5), expected, rtol=0.0, atol=1e-10)
    np.testing.assert_array_equal(free_run_V(network, run, 0.5), blocked_free_run_V(network, run, 0.5))
    assert np.ptp(expected) > 0.05


def test_blocks_hold_temperatures_that_were_not_trained() -> None:
    network, run = everything(1), measured_run()
    cold = replace(run, temperature_degC=run.temperature_degC - 60.0)
    assert network.partition.held.count(True) >= 1
    np.testing.assert_allclose(blocked_free_run_V(network, cold, 0.5), on_arrays_V(network, cold, 0.5), atol=1e-10)


@pytest.mark.parametrize("order", [1, 2])
def test_parts_begin_from_what_was_measured_there_or_settled(order: int) -> None:
    network, run = everything(order), measured_run(starts=(0, 700, 4095, 4096, 8999))
    voltage = run.voltage_V.copy()
    voltage[[0, 701, 4096]] = np.nan
    bare = replace(run, voltage_V=voltage)
    np.testing.assert_allclose(blocked_free_run_V(network, bare, 0.5), on_arrays_V(network, bare, 0.5), atol=1e-10)


def test_an_efficiency_below_one_counts_over_blocks() -> None:
    network = replace(everything(1), cell=CellContext(2.0, 0.97))
    run = measured_run()
    np.testing.assert_allclose(blocked_free_run_V(network, run, 0.4), on_arrays_V(network, run, 0.4), atol=1e-10)


def test_far_outside_all_boxes_the_nearest_one_takes_over() -> None:
    network, run = everything(0), measured_run(largest_A=400.0)
    expected = on_arrays_V(network, run, 0.5)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(blocked_free_run_V(network, run, 0.5), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("axis", ["soc", "surface_soc:0.05/400/3500", "surface_soc:0.05/400/3500/30"])
@pytest.mark.parametrize("largest_A", [5.0, 400.0])
def test_hats_run_in_blocks(axis: str, largest_A: float) -> None:
    network, run = hats(axis), measured_run(largest_A=largest_A)
    assert runs_in_blocks(network, run)
    expected = on_arrays_V(network, run, 0.5)
    np.testing.assert_allclose(blocked_free_run_V(network, run, 0.5), expected, rtol=1e-12, atol=1e-11)
    assert np.ptp(expected) > 0.2


@pytest.mark.parametrize("axis", ["soc", "surface_soc:0.05/400/3500", "surface_soc:0.05/400/3500/30"])
def test_hats_sample_by_sample_are_the_free_run(axis: str) -> None:
    network, run = hats(axis), measured_run(600, largest_A=9.0)
    net = flat_network(network)
    depth = 1 + int(max(net.tap_lag.max(), net.axis_lag.max()))
    filters, history, out = np.zeros((len(net.form), 3)), np.zeros((depth, len(net.form))), np.zeros((600, 1))
    weight = np.full(network.n_models, np.nan)
    for k in range(600):
        history[1:] = history[:-1].copy()
        soc = 0.5 + run.charge_Ah[k] / network.cell.capacity_Ah
        _STEP_SIGNALS(net, filters, history[0], run.current_A[k], 0.0, soc, 1.0, run.temperature_degC[k])
        if k == 0:
            history[1:] = history[0]
        out[k, 0] = _STEP_OUTPUT(net, history, weight, out, k, np.nan)
        assert weight.sum() == 1.0
    np.testing.assert_allclose(network.to_volts(out[:, 0]), on_arrays_V(network, run, 0.5), rtol=0.0, atol=1e-11)


def test_hats_come_back_from_a_document() -> None:
    network, run = hats(), measured_run(600)
    again = LocalModelNetwork.from_json(network.to_json())
    np.testing.assert_allclose(again.partition.centres, network.partition.centres, atol=1e-16)
    np.testing.assert_array_equal(free_run_V(again, run, 0.5), free_run_V(network, run, 0.5))


def test_other_kernels_and_missing_temperatures_take_the_arrays() -> None:
    run = measured_run(500)
    assert not runs_in_blocks(everything(1, "triangular"), run)
    assert not runs_in_blocks(everything(1), replace(run, temperature_degC=np.full(500, np.nan)))
    network = everything(1, "uniform")
    np.testing.assert_array_equal(free_run_V(network, run, 0.5), on_arrays_V(network, run, 0.5))


def test_memory_does_not_grow_with_the_run() -> None:
    import tracemalloc

    network = everything(0)
    free_run_V(network, measured_run(1000), 0.5)

    def peak(n: int) -> int:
        run = measured_run(n)
        tracemalloc.start()
        free_run_V(network, run, 0.5)
        largest = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return largest

    # Beside the result and a few of its size nothing grows: a regression's arrays would take some 200 bytes a sample.
    assert (peak(400_000) - peak(100_000)) / 300_000 < 40.0
