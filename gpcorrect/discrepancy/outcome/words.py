"""English for results, in one place: names of things, and numbers in the units that people read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.evidence.variables import Quantity, Span, Variable
from gpcorrect.discrepancy.naming.posterior import Level
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.search.candidates import Estimate

READER_UNITS = {
    "rad": ("°", 180.0 / np.pi),
    "m": ("mm", 1e3),
    "rad/s": ("°/s", 180.0 / np.pi),
    "m/s": ("mm/s", 1e3),
    "rad/s^2": ("°/s²", 180.0 / np.pi),
    "m/s^2": ("mm/s²", 1e3),
    "1": ("", 1.0),
    "rad per unit of source": ("rad for each rad (or m) of that joint", 1.0),
    "m per unit of source": ("m for each m (or rad) of that joint", 1.0),
}
MEANING = {
    Level.NONE: "nothing that matters beats noise, and what could still hide is shown to be too small to matter",
    Level.EXACT: "one name holds, on trajectories that the search had not seen, and no rival is left",
    Level.CLASS: "the kind of effect is sure, which one of its kind is not",
    Level.SET: "one of those listed is there; these data do not tell which",
    Level.UNKNOWN: "something real that no effect of the catalogue explains",
    Level.INCONCLUSIVE: "too little data, or nothing held on trajectories that the search had not seen",
}


def in_reader_units(value: float, unit: str) -> tuple[float, str]:
    """Return a value as people read it, with its unit: degrees and millimetres; other units stay.

    Parameters
    ----------
    value : float, SI
    unit : str
    """
    shown, factor = READER_UNITS.get(unit, (unit, 1.0))
    return factor * value, shown


def number(value: float) -> str:
    """Return three significant digits without an exponent where that is short; a dash for no number.

    Parameters
    ----------
    value : float, NaN is no number
    """
    if not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    digits = int(np.clip(2 - np.floor(np.log10(abs(value))), 0, 9))
    text = f"{value:.{digits}f}"
    return text if 1e-4 <= abs(value) < 1e6 else f"{value:.2e}"


def size_words(value: float, unit: str) -> str:
    """Return a value in the reader's unit: "1.2 mm", "0.4°".

    Parameters
    ----------
    value : float, SI
    unit : str
    """
    shown, symbol = in_reader_units(value, unit)
    return f"{number(shown)}{'' if symbol == '°' else ' '}{symbol}".strip()


def region_words(spans: Sequence[Span]) -> str:
    """Return where a residual is largest: "joint 2 moving back, load of joint 1 from 1 to 2 N m".

    Parameters
    ----------
    spans : sequence of Span, of a cell
    """
    return ", ".join(_span_words(span) for span in spans)


def _span_words(span: Span) -> str:
    match span.variable.quantity:
        case Quantity.DIRECTION:
            moving = {-1.0: "moving back", 1.0: "moving forward"}.get(span.low, "before its first move")
            return f"joint {span.variable.joint} {moving}"
        case Quantity.FREQUENCY:
            return f"a tone between {number(span.low)} and {number(span.high)} {span.variable.unit}"
        case Quantity.SESSION:
            return f"session {span.low + 1:.0f}"
    name, high = variable_words(span.variable), size_words(span.high, span.variable.unit)
    if span.low == span.high:
        return f"{name} at {high}"
    return f"{name} from {number(in_reader_units(span.low, span.variable.unit)[0])} to {high}"


def variable_words(variable: Variable) -> str:
    """Return a variable's name: "position of joint 2".

    Parameters
    ----------
    variable : Variable
    """
    return str(variable.quantity) if variable.joint is None else f"{variable.quantity} of joint {variable.joint}"


def place(joint: int | str | None) -> str:
    """Return where an effect sits: "joint 2", "the tool", "the base", "all joints".

    Parameters
    ----------
    joint : int, str or None, as effects have it
    """
    if isinstance(joint, int):
        return f"joint {joint}"
    return {"tool": "the tool", "base": "the base", "all": "all joints"}.get(str(joint), str(joint))


def channel_words(channel: Channel) -> str:
    """Return a channel's name: "outside sensor of joint 2", "tracker x".

    Parameters
    ----------
    channel : Channel
    """
    signals = {
        "external_jp": "outside sensor of joint",
        "measured_jp": "motor encoder of joint",
        "tracker_rotation": "tracker's turn about",
    }
    kind = signals.get(channel.signal, "tracker")
    return f"{kind} {channel.joint or 'xyz'[channel.index]}"


def noise_source_words(noise: ChannelNoise) -> str:
    """Return what a channel's noise was taken from.

    Parameters
    ----------
    noise : ChannelNoise
    """
    words = noise.source.value
    words += "" if noise.rounding_step is None else f"; rounded to {noise.rounding_step:.2g}"
    return words + ("" if noise.times_stated is None else f"; {noise.times_stated:.2g} times what [noise] states")


def estimate_words(estimate: Estimate, *, interval: bool = True) -> str:
    """Return a parameter, such as "118 N m/rad (105 to 131)"; sessions separated by semicolons.

    A size whose interval holds that of no effect is given as a bound alone: "below 0.2 mm", "above 400 N m/rad".

    Parameters
    ----------
    estimate : Estimate
    interval : bool, whether its 95 % interval is shown
    """
    value, ci95, unit = estimate.value, estimate.ci95, estimate.unit
    values = value if isinstance(value, tuple) else (value,)
    intervals: Sequence[object] = [None] * len(values)
    if ci95 is not None:
        intervals = ci95 if isinstance(value, tuple) else [ci95]
    entries = zip(values, intervals, estimate.nothing or [None] * len(values), strict=True)
    return "; ".join(_one(v, ends, nothing, unit, interval=interval) for v, ends, nothing in entries)


def _one(value: float | str, ends: object, nothing: float | None, unit: str, *, interval: bool) -> str:
    if not isinstance(value, float):
        return str(value)
    if isinstance(ends, tuple) and nothing is not None:
        stiff = np.isinf(nothing)
        return f"{'above' if stiff else 'below'} {size_words(ends[0] if stiff else max(map(abs, ends)), unit)}"
    text = size_words(value, unit)
    if not isinstance(ends, tuple) or not interval:
        return text
    low, high = (number(in_reader_units(float(end), unit)[0]) for end in ends)
    return f"{text} ({low} to {high})"
