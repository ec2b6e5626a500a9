"""Fits one peer library to the arrays that `peers.py` wrote, and writes its free runs; needs numpy and that library.

``python peer_worker.py PEER FOLDER``, in an environment of its own. `FOLDER/request.json` names the runs and settings,
`FOLDER/NAME.npz` holds current_A (positive charges), voltage_V, temperature_degC and soc on an even grid; written are
`FOLDER/simulated_NAME.npy` and `FOLDER/answer.json`. All choices are made on the training runs: each candidate is
fitted without the last of them (or the last third of a single one) and judged on it by its free-run error, and the
best one is fitted again to all.
"""

import contextlib
import io
import json
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Run = dict[str, Array]
Simulate = Callable[[Run], Array]
# Measured voltages that a free run may begin from.
N_INITIAL = 4
SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True)
class Setting:
    """What to fit: in words, and how; `fit(runs)` returns a function that simulates a run."""

    text: str
    fit: Callable[[list[Run]], Simulate]


def main() -> int:
    peer, folder = sys.argv[1], Path(sys.argv[2])
    request = json.loads((folder / "request.json").read_text())
    train = [dict(np.load(folder / f"{name}.npz")) for name in request["train"]]
    validate = {name: dict(np.load(folder / f"{name}.npz")) for name in request["validate"]}
    silent = io.StringIO()
    with warnings.catch_warnings(), contextlib.redirect_stdout(silent), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        settings = {"pybatteryid": pybatteryid_settings, "sysidentpy": sysidentpy_settings}[peer](request)
        began = time.perf_counter()
        chosen, tried = choose(settings, train, request["limit_s"])
        chosen_at = time.perf_counter()
        simulate = chosen.fit(train)
        final_s, fit_s = time.perf_counter() - chosen_at, time.perf_counter() - began
        began = time.perf_counter()
        for name, run in validate.items():
            np.save(folder / f"simulated_{name}.npy", simulate(run))
        run_s = time.perf_counter() - began
    n_samples = sum(len(run["current_A"]) for run in validate.values())
    answer = {
        "version": version(peer),
        "setting": chosen.text,
        "tried": tried,
        "fit_seconds": fit_s,
        "final_fit_seconds": final_s,
        "samples_per_second": n_samples / run_s,
    }
    (folder / "answer.json").write_text(json.dumps(answer))
    return 0


def choose(settings: list[Setting], train: list[Run], limit_s: float) -> tuple[Setting, list[dict[str, Any]]]:
    """Return the setting with the least free-run error on the training run left out; stops trying after `limit_s`."""
    rest, judged = (train[:-1], train[-1]) if len(train) > 1 else split(train[0])
    began, tried = time.perf_counter(), []
    best, least = settings[0], np.inf
    for setting in settings:
        if tried and time.perf_counter() - began > limit_s:
            break
        error_V = rmse_V(setting, rest, judged)
        tried.append({"setting": setting.text, "left_out_rmse_mV": 1e3 * error_V if np.isfinite(error_V) else None})
        if error_V < least:
            best, least = setting, error_V
    return best, tried


def rmse_V(setting: Setting, rest: list[Run], judged: Run) -> float:
    """Free-run error on a run that the fit did not see; infinite where it fails or diverges."""
    try:
        error = setting.fit(rest)(judged) - judged["voltage_V"]
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return np.inf
    value = float(np.sqrt(np.mean(error**2)))
    return value if np.isfinite(value) else np.inf


def split(run: Run) -> tuple[list[Run], Run]:
    """Cut a single run at two thirds."""
    at = 2 * len(run["current_A"]) // 3
    return [{key: column[:at] for key, column in run.items()}], {key: column[at:] for key, column in run.items()}


def pybatteryid_settings(request: dict[str, Any]) -> list[Setting]:
    """Orders and basis functions as in the package's own examples, with and without temperature.

    The package asks for the open-circuit voltage beforehand; it gets `request["emf"]`.
    """
    from pybatteryid import ModelStructure  # pyright: ignore[reportMissingImports]
    from pybatteryid.identification import identify_model  # pyright: ignore[reportMissingImports]
    from pybatteryid.simulation import simulate_model  # pyright: ignore[reportMissingImports]

    warm = request["emf"]["dVdT_values"] is not None
    functions = (
        ["d[0.01,0.99]", "s", "exp[[0.5*s]]", "exp[0.05*sqrt[|i|]]", "exp[[0.00366*T+1]^-1]"]
        if warm
        else ["d[0.01,0.99]", "s", "1/s", "log[s]", "exp[0.05*sqrt[|i|]]"]
    )
    emf = {key: np.array(value) for key, value in request["emf"].items() if value is not None}

    def dataset(run: Run, n_voltages: int) -> dict[str, Any]:
        out: dict[str, Any] = {
            "initial_soc": float(run["soc"][0]),
            "time_values": np.arange(len(run["soc"])) * request["dt_s"],
            "current_values": run["current_A"],
            "voltage_values": run["voltage_V"][:n_voltages],
        }
        return out | ({"temperature_values": run["temperature_degC"]} if warm else {})

    def setting(n: int, degree: int) -> Setting:
        def fit(runs: list[Run]) -> Simulate:
            structure = ModelStructure(request["capacity_Ah"] * SECONDS_PER_HOUR, request["dt_s"])
            structure.add_emf_function(emf)
            structure.add_basis_functions(functions)
            model = identify_model(
                [dataset(run, len(run["soc"])) for run in runs],
                structure,
                model_order=n,
                nonlinearity_order=degree,
                optimizers=["lassocv.sklearn", "ridgecv.sklearn"],
            )
            return lambda run: np.asarray(simulate_model(model, dataset(run, N_INITIAL)), dtype=np.float64)

        return Setting(f"n={n} l={degree}", fit)

    return [setting(n, degree) for n, degree in ((1, 1), (1, 2), (2, 1), (2, 2), (2, 3), (3, 3))]


def sysidentpy_settings(request: dict[str, Any]) -> list[Setting]:
    """Polynomial NARX of current, state of charge and temperature, terms chosen by FROLS and Akaike's criterion."""
    from sysidentpy.basis_function import Polynomial  # pyright: ignore[reportMissingImports]
    from sysidentpy.model_structure_selection import FROLS  # pyright: ignore[reportMissingImports]
    from sysidentpy.parameter_estimation import LeastSquares  # pyright: ignore[reportMissingImports]

    def inputs(run: Run) -> Array:
        # The package's inputs begin at k - 1; the current of k acts on the voltage of k at once.
        ahead = [np.append(run[key][1:], run[key][-1]) for key in ("current_A", "soc", "temperature_degC")]
        scaled = [ahead[0] / request["capacity_Ah"], ahead[1], ahead[2] / 25.0]
        return np.stack(scaled[: 3 if request["temperature"] else 2], axis=1)

    def setting(lags: int, degree: int) -> Setting:
        def fit(runs: list[Run]) -> Simulate:
            n_inputs = 3 if request["temperature"] else 2
            model = FROLS(
                order_selection=True,
                n_info_values=30,
                ylag=lags,
                xlag=[list(range(1, lags + 2)), *([1] for _ in range(n_inputs - 1))],
                info_criteria="aic",
                estimator=LeastSquares(),
                basis_function=Polynomial(degree=degree),
            )
            model.fit(
                X=np.vstack([inputs(run) for run in runs]),
                y=np.concatenate([run["voltage_V"] for run in runs])[:, None],
            )

            def simulate(run: Run) -> Array:
                begin = run["voltage_V"][: max(N_INITIAL, model.max_lag), None]
                return model.predict(X=inputs(run), y=begin).ravel()[: len(run["soc"])]

            return simulate

        return Setting(f"NARX degree {degree}, {lags} lags", fit)

    return [setting(lags, degree) for degree in (1, 2, 3) for lags in (1, 2)]


if __name__ == "__main__":
    sys.exit(main())
