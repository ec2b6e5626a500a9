"""The same design problem as a CasADi graph; reads it from standard input, prints one JSON line for each method.

Runs in an environment of its own (``pip install casadi numpy``), which needs nothing of this project. Structure: one
past output, SoC(k-1), current(k), current(k-1), local models along SoC(k-1).
"""

import json
import sys
import time

import casadi as ca  # pyright: ignore[reportMissingImports]
import numpy as np

_STEPS = 40
_IPOPT_ITERATIONS = 150
_IPOPT_S = 60.0


def build(problem: dict) -> tuple:
    """Return functions: sensitivities of a current, and its derivative; criterion of the sensitivities."""
    network = problem["network"]
    theta = np.array(network["theta"])
    n_models, p = theta.shape
    lower, upper = (np.array(network["partition"][side])[:, 0] for side in ("lower", "upper"))
    centre, width = 0.5 * (lower + upper), (upper - lower) * network["structure"]["axes"][0]["k_sigma"]
    scale = {name: tuple(bounds) for name, bounds in network["scaling"].items()}
    per_A = network["structure"]["dt_s"] / 3600.0 / network["cell"]["capacity_Ah"]
    size = n_models * p
    state, current = ca.SX.sym("x", 3 + size), ca.SX.sym("u")
    y, soc, before, carried = state[0], state[1], state[2], state[3:]

    def normal(value, name):
        low, high = scale[name]
        return (value - low) / (high - low)

    z = normal(soc, "soc")
    mu = ca.exp(-0.5 * ((z - centre) / width) ** 2)
    phi = mu / ca.sum1(mu)
    regressor = ca.vertcat(y, z, normal(current, "current"), normal(before, "current"), 1.0)
    blended = ca.DM(theta.T) @ phi
    psi = ca.reshape(regressor @ phi.T, size, 1)
    if problem["free_run"]:
        psi = psi + blended[0] * carried
    after = ca.vertcat(ca.dot(blended, regressor), soc + current * per_A, current, psi)
    step = ca.Function("step", [state, current], [after])
    n = problem["n_samples"]
    u = ca.MX.sym("u", 1, n)
    rest = first_output(theta, centre, width, scale, problem["initial_soc"])
    start = ca.vertcat(rest, problem["initial_soc"], 0.0, ca.DM.zeros(size))
    path = step.mapaccum("path", n)(start, u)
    return u, path, size, scale


def first_output(theta: np.ndarray, centre: np.ndarray, width: np.ndarray, scale: dict, soc: float) -> float:
    """Settled normalised output at rest."""
    z = (soc - scale["soc"][0]) / (scale["soc"][1] - scale["soc"][0])
    zero = -scale["current"][0] / (scale["current"][1] - scale["current"][0])
    mu = np.exp(-0.5 * ((z - centre) / width) ** 2)
    blended = (mu / mu.sum()) @ theta
    return float(blended[1:] @ np.array([z, zero, zero, 1.0]) / (1.0 - blended[0]))


def main() -> int:
    problem = json.load(sys.stdin)
    u, path, size, scale = build(problem)
    n, amplitude = problem["n_samples"], problem["amplitude_A"]
    prior = np.array(problem["prior"])
    variance = (problem["noise_V"] / (scale["voltage"][1] - scale["voltage"][0])) ** 2
    psi = path[3:, :]
    sensitivities = ca.Function("sensitivities", [u], [psi])
    weights = ca.MX.sym("w", size, n)
    back = ca.Function("back", [u, weights], [ca.gradient(ca.sum1(ca.sum2(weights * psi)), u)])

    def value(current: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        rows = np.array(sensitivities(current))
        information = rows @ rows.T / variance + prior
        return float(np.linalg.slogdet(information)[1]), rows, information

    def ascend(start: np.ndarray) -> np.ndarray:
        current, step = start, 0.3 * amplitude
        reached, rows, information = value(current)
        for _ in range(_STEPS):
            gradient = np.array(back(current, 2.0 / variance * np.linalg.solve(information, rows))).ravel()
            while step > 1e-3 * amplitude:
                moved = np.clip(current + step * gradient / np.abs(gradient).mean(), -amplitude, amplitude)
                found = value(moved)
                if found[0] > reached:
                    break
                step *= 0.25
            else:
                break
            current, (reached, rows, information), step = moved, found, 2.0 * step
        return current

    rng = np.random.default_rng(0)
    start = rng.uniform(-amplitude, amplitude, n)
    value(start)
    began = time.perf_counter()
    current = ascend(start)
    report("casadi, gradient ascent, 1 start", current, time.perf_counter() - began)
    triangle = ca.Function("log_det", [(m := ca.SX.sym("m", size, size))], [2.0 * ca.sum1(ca.log(ca.diag(ca.chol(m))))])
    criterion = triangle(psi @ psi.T / variance + prior)
    program = {"x": ca.vec(u), "f": -criterion}
    options = {
        "ipopt.print_level": 0,
        "print_time": 0,
        "ipopt.hessian_approximation": "limited-memory",
        "ipopt.max_iter": _IPOPT_ITERATIONS,
        "ipopt.max_cpu_time": _IPOPT_S,
        "ipopt.sb": "yes",
    }
    solver = ca.nlpsol("solver", "ipopt", program, options)
    began = time.perf_counter()
    found = solver(x0=0.5 * start, lbx=-amplitude, ubx=amplitude)
    report("casadi, IPOPT, 1 start", np.array(found["x"]).ravel(), time.perf_counter() - began)
    return 0


def report(method: str, current: np.ndarray, seconds: float) -> None:
    print(json.dumps({"method": method, "current_A": current.tolist(), "seconds": seconds}), flush=True)


if __name__ == "__main__":
    sys.exit(main())
