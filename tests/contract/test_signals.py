"""What every kind of signal owes, and that a new one is one new file: arrays, fit, loops and command line find it."""

import importlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from bench_service.cli.main import main
from models.data.errors import StructureError
from models.design.information.experiment import Evaluator, Experiment
from models.network import signals
from models.network.compiled_network import flat_network
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import Parameter, parse_signal, signal_kinds
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver
from models.recursive.update import RecursiveUpdate
from tests.contract import signal_checks as checks
from tests.unit.models import hand_network, synthetic

KINDS = sorted(signal_kinds())
IN_ARRAYS = (
    checks.values_are_finite,
    checks.settled_is_the_end_of_a_long_held_run,
    checks.a_step_is_that_of_a_run,
)
IN_LOOPS = (
    checks.the_compiled_step_makes_the_arrays,
    checks.the_observer_makes_what_the_compiled_step_makes,
    checks.the_gradient_is_that_of_differences,
)
# The magnitude of the current through a low-pass: nothing but what the loops' vocabulary has.
MAGNITUDE = '''
"""Low-passed magnitude of the current."""

import numpy as np

from models.network.signals.driven import TIME_CONSTANT, driven_form, slowed, slowed_from_first
from models.network.signals.kind import SignalKind
from models.network.signals.loop_form import MAGNITUDE

KIND = SignalKind(
    name="magnitude",
    title="low-passed magnitude of the current in A",
    example="magnitude:60",
    parameters=(TIME_CONSTANT,),
    values=lambda signal, run: slowed(signal, np.abs(run.current_A), run.dt_s),
    settled=lambda signal, points: np.abs(points.current_A),
    after_step=lambda signal, step: slowed_from_first(signal, np.abs(step.current_A), step.dt_s),
    loop=lambda signal, dt_s, capacity_Ah: driven_form(signal, dt_s, capacity_Ah, entry=MAGNITUDE),
)
'''
# A product that the loops have no form for.
LEANING = '''
"""Current times the distance of the state of charge from the middle."""

from models.network.signals.kind import SignalKind


def _product(signal, points):
    return points.current_A * (points.soc - 0.5)


KIND = SignalKind(
    name="leaning",
    title="current times the distance of the state of charge from the middle, in A",
    example="leaning",
    values=_product,
    settled=_product,
    after_step=_product,
    loop=None,
)
'''


@pytest.mark.parametrize("name", KINDS)
def test_describes_itself(name: str) -> None:
    kind = signal_kinds()[name]
    module = importlib.import_module(f"{signals.__name__}.{name}")
    assert kind is module.KIND and kind.name == name
    assert module.__doc__ and kind.title
    assert all(isinstance(each, Parameter) and each.name and each.unit for each in kind.parameters)
    # What may be left out stands last.
    assert [each.optional for each in kind.parameters] == sorted(each.optional for each in kind.parameters)


@pytest.mark.parametrize("name", KINDS)
def test_the_name_parses(name: str) -> None:
    kind = signal_kinds()[name]
    example = parse_signal(kind.example)
    assert example.definition is kind and example.name == kind.example
    assert list(example.parameters) == [each.name for each in kind.parameters]
    values = list(example.parameters.values())
    for count in range(len(values) + 2):
        shorter = name + ":" * (count > 0) + "/".join(f"{value:g}" for value in [*values, 1.0][:count])
        if sum(not each.optional for each in kind.parameters) <= count <= len(values):
            assert parse_signal(shorter).parameters == dict(list(example.parameters.items())[:count])
        else:
            with pytest.raises(StructureError, match=name):
                parse_signal(shorter)


@pytest.mark.parametrize("check", [*IN_ARRAYS, *IN_LOOPS], ids=lambda check: check.__name__)
def test_a_mean_is_no_further_behind_than_a_curve_goes_on(check: Callable[[str], None]) -> None:
    """So deep a surface is beyond all curves most of the time."""
    check("behind_surface:3/20/3500")


@pytest.mark.parametrize("check", [*IN_ARRAYS, *IN_LOOPS], ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", KINDS)
def test_promise(name: str, check: Callable[[str], None]) -> None:
    kind = signal_kinds()[name]
    if check in IN_LOOPS and kind.loop is None:
        with pytest.raises(StructureError, match=name):
            check(kind.example)
        return
    check(kind.example)
    if kind.parameters and kind.parameters[-1].optional:
        needed = [f"{value:g}" for value in parse_signal(kind.example).parameters.values()]
        check(f"{name}:" + "/".join(needed[: sum(not each.optional for each in kind.parameters)]))


@pytest.fixture
def new_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str], None]]:
    """Write one more file of the package, for one test."""
    folder, names = tmp_path / "signals", []
    folder.mkdir()
    monkeypatch.setattr(signals, "__path__", [*signals.__path__, str(folder)])

    def write(name: str, text: str) -> None:
        (folder / f"{name}.py").write_text(text)
        names.append(name)
        importlib.invalidate_caches()
        signal_kinds.cache_clear()

    yield write
    for name in names:
        sys.modules.pop(f"{signals.__name__}.{name}", None)
        vars(signals).pop(name, None)
    signal_kinds.cache_clear()


def test_a_new_kind_is_one_new_file(new_file: Callable[[str, str], None], tmp_path: Path) -> None:
    new_file("magnitude", MAGNITUDE)
    assert parse_signal("magnitude:60").get("time_constant_s") == 60.0
    for check in (*IN_ARRAYS, *IN_LOOPS):
        check("magnitude:60")
    network = _fitted(tmp_path, "magnitude:60")
    _free_run_is_that_of_the_arrays(network)
    assert network.record.observer
    observer, n = FuzzyObserver(network), 300
    _, out = observer.replay(observer.initial(0.6), np.full(n, 1.0), np.full(n, 3.8), np.full(n, 25.0))
    assert np.isfinite(out).all()
    value, gradient = Evaluator(Experiment(network, 0.5, 2e-3), 30).value_and_gradient(np.full(30, 1.0))
    assert np.isfinite(value) and np.isfinite(gradient).all()
    RecursiveUpdate(network).step(RecursiveUpdate(network).initial(0.5), 1.0, 3.8, 25.0)


def test_a_kind_without_a_loop_form_is_fitted_and_refused_where_a_loop_is_needed(
    new_file: Callable[[str, str], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new_file("leaning", LEANING)
    for check in IN_ARRAYS:
        check("leaning")
    network = _fitted(tmp_path, "leaning")
    _free_run_is_that_of_the_arrays(network)
    words = "signal 'leaning' cannot be made sample by sample.* use a model without it, or give 'leaning' a loop form"
    assert any("observer not tuned: signal 'leaning'" in text for text in network.record.reservations)
    for refused in (
        flat_network,
        FuzzyObserver,
        RecursiveUpdate,
        lambda network: Evaluator(Experiment(network, 0.5, 2e-3), 30),
    ):
        with pytest.raises(StructureError, match=words):
            refused(network)
    capsys.readouterr()
    model, run = str(tmp_path / "model.json"), str(tmp_path / "run.csv")
    assert main(["compare", model, run, "--report", str(tmp_path / "page.html"), "--json"]) == 0
    assert main(["diagnose", model, run, "--mode", "structure", "--train", run, "--json"]) == 0
    capsys.readouterr()
    assert main(["observe", model, run]) == 2
    assert "signal 'leaning' cannot be made sample by sample" in capsys.readouterr().err


def _fitted(folder: Path, name: str) -> LocalModelNetwork:
    """A model that the command line fits with a structure file that names the signal."""
    inputs = (InputChannel("soc", delay=1), InputChannel("current", order=1), InputChannel(name))
    structure = Structure(1, inputs, (PartitionAxis("soc", initial=2),), 1.0)
    (folder / "structure.json").write_text(json.dumps(structure.to_json()))
    run = synthetic.run(3000, 1, noise_V=1e-3)
    columns = {
        "time_s": run.time_s,
        "current_A": run.current_A,
        "voltage_V": run.voltage_V,
        "temperature_degC": run.temperature_degC,
        "soc_ref": run.soc_ref,
    }
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "run.csv", table, delimiter=",", header=",".join(columns), comments="")
    model = folder / "model.json"
    command = ["fit", str(folder / "run.csv"), "--capacity-Ah", f"{synthetic.CAPACITY_AH:g}", "--out", str(model)]
    assert main([*command, "--structure", str(folder / "structure.json"), "--json"]) == 0
    network = LocalModelNetwork.from_json(json.loads(model.read_text()))
    assert name in network.structure.signals
    return network


def _free_run_is_that_of_the_arrays(network: LocalModelNetwork) -> None:
    """A short run goes through the arrays, a long one through blocks where there is a form."""
    current = np.repeat(np.random.default_rng(2).uniform(-3.0, 3.0, 60), 20)
    run = hand_network.grid_run(current, 25.0)
    short = hand_network.grid_run(current[:200], 25.0)
    np.testing.assert_allclose(free_run_V(network, run, 0.5)[:200], free_run_V(network, short, 0.5), rtol=0, atol=1e-9)
