"""Words and rounded figures with units: no name of a field and no power of ten with an e reaches a reader."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from bench_service.durations import in_words

NOTHING = "–"
_UNITS = {"Ohm": "Ω", "degC": "°C", "1": "", "sign": "", "1/Ah": "per Ah"}
# Units of which a thousandth has a name that a laboratory uses.
_SCALED = ("V", "A", "Ohm", "Ah", "V/K", "Wh", "W", "W/K", "K/W")
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_VARIABLES = {
    "soc": "state of charge",
    "current_A": "current",
    "temperature_degC": "temperature",
    "ambient_degC": "ambient temperature",
    "direction": "direction of the last current",
    "since_step_s": "time since the last current step",
    "throughput_Ah": "charge moved since the start",
    "time_h": "time since the start",
    "slow_current_A": "current of the last minutes",
    "progress": "part of the test",
}
_STATES = {
    "fault": "ended by a fault",
    "interrupted": "cut off",
    "stopped": "stopped by somebody",
    "created": "not started yet",
}
_ABBREVIATIONS = ("aprbs", "hppc", "prbs")
_QUOTES = "'\""
_NAMES = re.compile(r"""(?<!\w)'[^']*'(?!\w)|"[^"]*"|\b[A-Za-z]+(?:_[A-Za-z]+)+\b""")
_SUFFIX = re.compile(r"_(?:mV|V|A|Ah|Ohm|mOhm|s|h|K|degC|Wh|W|V_per_K|W_per_K|K_per_W|J_per_K|per_Ah)$")


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with so many digits that count; a power of ten only where nothing else can be read."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(value)) + 1e-12)
    if exponent < -4 or exponent > 7:
        return f"{value / 10.0**exponent:.{digits - 1}f} · 10{str(exponent).translate(_SUPERSCRIPT)}".replace("-", "−")
    return f"{value:.{max(0, digits - 1 - exponent)}f}".replace("-", "−")


def quantity(value: float | None, unit: str, std: float | None = None, digits: int = 3) -> str:
    """Write a value with its unit, in thousandths where it is small; with a standard deviation as ± that.

    The standard deviation has two digits, the value as many decimals as that.
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    scale, prefix = _scale(value, unit)
    shown = _UNITS.get(unit, unit.replace("Ohm", "Ω").replace("degC", "°C"))
    unit_text = f" {prefix}{shown}" if shown else ""
    if std is None or not math.isfinite(std) or std <= 0.0:
        return f"{number(value / scale, digits)}{unit_text}"
    decimals = max(0, 1 - math.floor(math.log10(std / scale)))
    if decimals > 6:
        return f"{number(value / scale, digits)} ± {number(std / scale, 2)}{unit_text}"
    return f"{value / scale:.{decimals}f} ± {std / scale:.{decimals}f}{unit_text}".replace("-", "−")


def _scale(value: float, unit: str) -> tuple[float, str]:
    if unit not in _SCALED or value == 0.0:
        return 1.0, ""
    return next(((scale, prefix) for scale, prefix in _PREFIXES if abs(value) >= 0.1 * scale), _PREFIXES[-1])


def millivolts(value_mV: float | None) -> str:
    """Write an error in mV."""
    if value_mV is None or not math.isfinite(value_mV):
        return NOTHING
    digits = 1 if abs(value_mV) >= 10.0 else 2
    return f"{round(value_mV, digits) + 0.0:.{digits}f} mV".replace("-", "−")


def percent(share: float | None, digits: int = 0) -> str:
    """Write a share as percent."""
    return NOTHING if share is None or not math.isfinite(share) else f"{100.0 * share:.{digits}f} %".replace("-", "−")


def count(value: int | None) -> str:
    """Write a whole number, thousands apart."""
    return NOTHING if value is None else f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def duration(seconds: float | None) -> str:
    """Write a time as a person says it."""
    if seconds is None or not math.isfinite(seconds):
        return NOTHING
    return in_words(seconds)


def moment(utc: str | None) -> str:
    """Write a stored moment to the minute."""
    return NOTHING if utc is None else f"{utc[:10]} {utc[11:16]} UTC"


def span(moments: Sequence[str | None]) -> str | None:
    """Write from when to when things happened; None where nobody knows."""
    known = sorted(each for each in moments if each is not None)
    if not known:
        return None
    first, last = moment(known[0]), moment(known[-1])
    if first[:10] == last[:10]:
        return first if first == last else f"{first.removesuffix(' UTC')} to {last[11:]}"
    return f"{first} to {last}"


def made_by(version: str, now: datetime | None = None) -> str:
    """Say when a report was made, and by what."""
    return f"Made {moment((now or datetime.now(UTC)).isoformat())} by bench-service {version}."


def variable(name: str) -> str:
    """What a reader calls a variable."""
    return _VARIABLES.get(name, plain(name))


def plain(name: str) -> str:
    """Turn a name of the program into words."""
    return name.upper() if name in _ABBREVIATIONS else _SUFFIX.sub("", name).replace("_", " ")


def state(name: str) -> str:
    """What has become of a run or a campaign."""
    return _STATES.get(name, name)


def effect(name: str) -> str:
    """What a reader calls a physical effect."""
    # Lazy: numba and scipy take 1.0 s.
    from models.effects import effects

    known = effects()
    return known[name].title if name in known else plain(name).capitalize()


def told(text: str) -> str:
    """Take names of the program and spelt-out units out of a sentence; what stands in quotes stays as it was given."""
    text = _NAMES.sub(lambda found: found[0] if found[0][0] in _QUOTES else plain(found[0]), text)
    for spelt, sign in (("degC", "°C"), ("Ohm", "Ω"), (" +- ", " ± ")):
        text = text.replace(spelt, sign)
    return text


def between(name: str, ends: Sequence[float], unit: str) -> str:
    """Write a range of a variable, rounded to what tells its ends apart."""
    low, high = ends
    if unit == "sign":
        return "after a charge" if low > 0.0 else "after a discharge"
    if name == "soc":
        decimals = next((n for n in range(3) if f"{100.0 * low:.{n}f}" != f"{100.0 * high:.{n}f}"), 0)
        return f"{100.0 * low:.{decimals}f} to {100.0 * high:.{decimals}f} %"
    if unit == "s":
        return f"{duration(low)} to {duration(high)}"
    scale, prefix = _scale(max(abs(low), abs(high)), unit)
    largest = max(abs(low), abs(high), 1e-12) / scale
    decimals = max(0, 2 - math.floor(math.log10(largest) + 1e-12))
    texts = (f"{round(end / scale, decimals) + 0.0:.{decimals}f}".replace("-", "−") for end in (low, high))
    shown = _UNITS.get(unit, unit)
    return f"{' to '.join(texts)}{f' {prefix}{shown}' if shown else ''}"


def parameters(found: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Pairs of name and value of the parameters of an effect."""
    return [(plain(name), quantity(each["value"], each["unit"], each["std"])) for name, each in found.items()]


def sentence(text: str) -> str:
    """Write a text as a sentence of its own."""
    text = text.strip()
    return f"{upper_first(text)}{'' if text.endswith(('.', '!', '?', ':')) else '.'}" if text else ""


def upper_first(text: str) -> str:
    """Write the first letter large, the others as they are."""
    return f"{text[:1].upper()}{text[1:]}"


def listed(texts: Sequence[str], last: str = "and") -> str:
    """Write texts after each other."""
    return f" {last} ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else "".join(texts)
