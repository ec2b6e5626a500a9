"""What a demo tells in the end, as JSON and as tables: however its campaign ended, all that it came to before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

if TYPE_CHECKING:
    from rich.console import Console

    from simulators.hidden_effect import HiddenEffect


def demo_answer(record: dict[str, Any], hidden: HiddenEffect | None, seconds: float) -> dict[str, Any]:
    """Return the `demo` object of the public contract, of a campaign that may have failed on its way."""
    result = record["result"] or {}
    diagnosis = result.get("diagnosis") or {}
    findings = diagnosis.get("findings") or []
    named = findings[0]["effect"] if diagnosis.get("verdict") in ("missing", "ambiguous") and findings else None
    opened = None if hidden is None else {"value": hidden.value, "before": hidden.before, "unit": hidden.unit}
    return {
        "runs": [run["run_id"] for run in result.get("runs", [])],
        "samples": result.get("samples", 0),
        "missed_ticks": result.get("missed_ticks", 0),
        "rounds": result.get("rounds", []),
        "model_chain": result.get("model_chain", []),
        "hidden_effect": None if hidden is None else hidden.name,
        "hidden_size": opened,
        "seal": None if hidden is None else {"sha256": hidden.seal, "contents": hidden.contents},
        "verdict": diagnosis.get("verdict"),
        "diagnosed_effect": named,
        "soc_rmse": (result.get("soc") or {}).get("rmse"),
        "seconds": seconds,
    }


def show_demo(console: Console, record: dict[str, Any], answer: dict[str, Any]) -> None:
    """Tell a person how the campaign went, what it found, and what was hidden."""
    stages = Table(box=box.SIMPLE_HEAD)
    for heading in ("stage", "state", "seconds", "what"):
        stages.add_column(heading, justify="right" if heading == "seconds" else "left", overflow="fold")
    for stage in record["stages"]:
        seconds = "" if stage["seconds"] is None else f"{stage['seconds']:.1f}"
        stages.add_row(stage["name"], stage["state"], seconds, stage["detail"])
    console.print(stages)
    if record["state"] != "completed":
        console.print(f"The campaign ended as {record['state']}: {record['message']}")
    if record["result"]:
        console.print(_figures(record["result"], answer))
        _show_diagnosis(console, record["result"], answer)
    _open_seal(console, answer)
    console.print(f"Data: {answer['data']}")
    for run in (record["result"] or {}).get("runs", []):
        console.print(f"Run:  {run['run_id']} ({run['role']}, from SoC {run['initial_soc']:.4g})")


def _show_diagnosis(console: Console, result: dict[str, Any], answer: dict[str, Any]) -> None:
    """What the campaign found, and what adding it was worth."""
    found = result.get("diagnosis")
    if found is None:
        return
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.reports.diagnosis import confidence

    console.print(f"Verdict: [bold]{found['verdict'].replace('_', ' ')}[/bold]")
    for finding in found["findings"][:3]:
        console.print(
            f"  {finding['rank']}. {finding['effect']}, confidence {confidence(finding['confidence'])}: "
            f"{finding['explanation']}"
        )
    for version in answer["model_chain"]:
        effect = "model" if version["effect"] is None else f"with {version['effect']}"
        console.print(f"  {effect}: {version['validation_rmse_mV']:.2f} mV on a run that it never saw")


def _open_seal(console: Console, answer: dict[str, Any]) -> None:
    """What was hidden, however the campaign ended."""
    if answer["hidden_effect"] is not None:
        size = answer["hidden_size"]
        console.print(
            f"The seal is opened: {answer['hidden_effect']}, {size['value']:g} {size['unit']} "
            f"where the cell had {size['before']:g}"
        )
        console.print(f"  {answer['seal']['sha256']} = SHA-256 of {answer['seal']['contents']!r}")


def _figures(result: dict[str, Any], answer: dict[str, Any]) -> Any:

    table = Table(box=box.SIMPLE_HEAD, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    rows = [("samples stored", f"{answer['samples']}"), ("missed ticks", f"{answer['missed_ticks']}")]
    if "train" in result:
        rows.append(("free-run voltage error, training run", f"{result['train']['rmse_mV']:.2f} mV"))
    if "validation" in result:
        noise = result["sensor_noise_mV"]
        rows.append(("free-run voltage error, run the fit never saw", _held_out(result)))
        rows.append(("sensor noise", "unknown" if noise is None else f"{noise:.2f} mV"))
    for name, value in [*rows, *_observed(result), ("time", f"{answer['seconds']:.0f} s")]:
        table.add_row(name, value)
    return table


def _observed(result: dict[str, Any]) -> list[tuple[str, str]]:
    """Of the live observer, where it ran to the end."""
    soc = result.get("soc")
    if soc is None:
        return []
    converged = soc["converged_after_s"]
    return [
        ("live observer: started off by", f"{100 * soc['started_off_by']:.0f} % SoC"),
        ("live observer: below 3 % after", _after(converged)),
        ("live observer: SoC error after that, RMS", f"{100 * soc['rmse']:.2f} %"),
        ("live observer: SoC error after that, largest", f"{100 * soc['max_error']:.2f} %"),
    ]


def _after(converged_s: float | None) -> str:
    if converged_s is None:
        return "never"
    return f"{converged_s:.0f} s" if converged_s > 0.0 else "the first sample"


def _held_out(result: dict[str, Any]) -> str:
    """Error after each round."""
    return ", then ".join(f"{each['validation_rmse_mV']:.2f}" for each in result["rounds"]) + " mV"
