"""Charts of the discrepancy page: what the names close, their posterior, the search's gains, likeness, residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from gpcorrect.discrepancy.naming.posterior import Alternative
from gpcorrect.discrepancy.outcome.result import ChannelGap, Evidence
from gpcorrect.discrepancy.outcome.words import channel_words, in_reader_units
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.search.state import Step
from gpcorrect.report.page import Chart, Mark, Panel, Role, Series
from gpcorrect.rigid.registration import evenly_spaced
from gpcorrect.sim.body import Body
from gpcorrect.types import FloatArray

WIDE = 30.0  # largest over smallest: beyond, a linear scale hides the small ones
MOST_BARS = 6  # of one effect's posterior
MOST_POINTS = 1500  # drawn of one direction in one panel; chosen by hand
BINS = 24  # of a running median
CELLS = 12  # of a map, along each axis
FEWEST = 3  # rows in a cell that is drawn
DIRECTIONS = ((1.0, Role.RAW, "forward"), (-1.0, Role.CORRECTED, "back"))
STATES = ("before", "with the named effects")


def _rms_left(gap: ChannelGap, closed: float) -> float:
    """Root mean square that is left when this fraction of the gap is closed."""
    left = gap.noise**2 + (1.0 - closed) * (gap.before**2 - gap.noise**2)
    return float(np.sqrt(max(left, 0.0))) if np.isfinite(left) else np.nan


MARKS: tuple[tuple[Callable[[ChannelGap], float], Mark, Role, str], ...] = (
    (lambda g: g.before, Mark.DOTS, Role.RAW, "before"),
    (lambda g: g.after, Mark.DOTS, Role.CORRECTED, "with the named effects"),
    (lambda g: g.noise, Mark.CROSSES, Role.INK, "noise"),
    (lambda g: _rms_left(g, g.black_box_ceiling), Mark.DOTS, Role.RIGID, "black box (ceiling)"),
    (lambda g: _rms_left(g, g.permutation_control), Mark.CROSSES, Role.DROPPED, "permutation control"),
)


def gap_chart(gaps: Sequence[ChannelGap]) -> Chart:
    """Return the test set's figures, a row a channel, angles and lengths apart.

    Parameters
    ----------
    gaps : sequence of ChannelGap
    """
    units = [u for u in ("rad", "m") if any(g.channel.unit == u for g in gaps)]
    panels = [_gap_panel([g for g in gaps if g.channel.unit == unit], *in_reader_units(1.0, unit)) for unit in units]
    return Chart("Root mean squares: the grey bar is what the named effects close.", panels, columns=len(units))


def _gap_panel(gaps: Sequence[ChannelGap], scale: float, symbol: str) -> Panel:
    rows = np.arange(len(gaps))
    values = [scale * np.array([size(g) for g in gaps]) for size, *_ in MARKS]
    before, after = values[:2]
    series = [Series("closed", Mark.BARS, Role.QUIET, after, rows, x2=before, size=0.08)]
    for value, (_, mark, role, name) in zip(values, MARKS, strict=True):
        series.append(Series(name, mark, role, value, rows, size=9.0))
    seen = np.concatenate(values)
    seen = seen[np.isfinite(seen) & (seen > 0)]
    log = len(seen) > 0 and seen.max() > WIDE * seen.min()
    limits = (0.7 * float(seen.min()), 1.4 * float(seen.max())) if log else (0.0, 1.1 * float(seen.max(initial=1e-12)))
    label, names = f"root mean square [{symbol}]", [channel_words(g.channel) for g in gaps]
    return Panel(label, "", series, rows=names, log_x=bool(log), x_range=limits)


def posterior_chart(effects: Sequence[tuple[str, Sequence[Alternative]]]) -> Chart:
    """Return the posterior of what could stand in each effect's place, nothing and unknown among it.

    Parameters
    ----------
    effects : sequence of (str, sequence of Alternative), title, and what could stand in its place, most probable first
    """
    panels = []
    for title, alternatives in effects:
        always = [a for a in alternatives if not a.is_effect]
        likeliest = [a for a in alternatives if a.is_effect][: MOST_BARS - len(always)]
        shown = sorted([*likeliest, *always], key=lambda a: -a.probability)
        series = []
        for role, name, wanted in ((Role.CORRECTED, "effects", True), (Role.QUIET, "nothing, unknown", False)):
            rows = [i for i, a in enumerate(shown) if a.is_effect == wanted]
            value = [100 * shown[i].probability for i in rows]
            words = [f"{v:.0f} %" for v in value]
            series.append(Series(name, Mark.BARS, role, [0.0] * len(rows), rows, x2=value, labels=words))
        labels = [a.label for a in shown]
        panels.append(Panel("probability [%]", "", series, title=title, rows=labels, x_range=(0.0, 118.0)))
    caption = "What could stand in each effect's place. Grey: nothing, and anything outside the catalogue."
    return Chart(caption, panels, columns=2)


def waterfall_chart(steps: Sequence[Step]) -> Chart:
    """Return the held-out gain of every step of the search, on a logarithmic scale; removals are of another colour.

    Parameters
    ----------
    steps : sequence of Step, in their order
    """
    nats = np.array([s.nats for s in steps])
    sizes, series = np.maximum(np.abs(nats), 1.1), []
    for role, name, chosen in ((Role.CORRECTED, "added", nats > 0), (Role.RAW, "taken out again", nats <= 0)):
        rows = np.flatnonzero(chosen)
        words = [f"{value:+,.0f}".replace(",", " ") for value in nats[rows]]
        if rows.size:
            series.append(Series(name, Mark.BARS, role, np.ones(len(rows)), rows, x2=sizes[rows], labels=words))
    label = "log Bayes factor on held-out trajectories [nats], in the order of the search"
    panel = Panel(label, "", series, rows=[s.label for s in steps], log_x=True, x_range=(1.0, 8.0 * float(sizes.max())))
    return Chart("Held-out log Bayes factor of every step of the search.", [panel])


def likeness_chart(correlation: FloatArray, labels: Sequence[str]) -> Chart:
    """Return the cosines between whitened signatures: near 1 or -1, these data cannot tell two apart.

    Parameters
    ----------
    correlation : (p, p) array, cosines
    labels : sequence of str
    """
    i, j = (grid.ravel() for grid in np.indices(correlation.shape))
    text = [f"{one} and {other}" for one in labels for other in labels]
    x, y, cosine = j - 0.5, i - 0.5, correlation.ravel()
    cells = Series("cosine", Mark.CELLS, Role.RAW, x, y, x2=x + 1, y2=y + 1, value=cosine, text=text)
    names = [str(n + 1) for n in range(len(labels))]
    whole = (-0.5, len(labels) - 0.5)
    numbered = list(map(" ".join, zip(names, labels, strict=True)))
    panel = Panel("the same, by number", "", [cells], rows=numbered, x_names=names, x_range=whole, largest=1.0)
    caption = "Likeness of the whitened signatures: in full colour (cosine near 1 or -1) two effects look alike here."
    return Chart(caption, [panel])


def loop_chart(evidence: Evidence, channels: Sequence[tuple[int, Channel]], body: Body) -> Chart:
    """Return residual against position on the test set, a row for each channel, before and after.

    Parameters
    ----------
    evidence : Evidence
    channels : sequence of (int, Channel)
        Which ones, with their columns; one of no single joint is drawn against the joint that spreads it most.
    body : Body, for the joints' numbers and types
    """
    panels = []
    for index, channel in channels:
        column = evidence.joint[index] if evidence.joint[index] >= 0 else _most_explaining(evidence, index)
        along, joint = _axis(body, column)
        scale, symbol = in_reader_units(1.0, channel.unit)
        limits = _limits(scale * evidence.before[evidence.test, index])
        for title, values in zip(STATES, (evidence.before[:, index], evidence.after[:, index]), strict=True):
            labels = f"motor position, {joint}", f"measured − simulated [{symbol}]"
            series = _loops(evidence, along * evidence.motor[:, column], scale * values, column)
            titled = f"{channel_words(channel)}: {title}"
            panels.append(Panel(*labels, series, title=titled, y_range=limits, height=240))
    caption = (
        "Test set. Two separate lines are a loop: play, friction or hysteresis; one bent line is geometry or load; "
        "a line at zero is explained. Lines are running medians."
    )
    return Chart(caption, panels, columns=2)


def _axis(body: Body, column: int) -> tuple[float, str]:
    """Return the reader's units in an SI one of a joint's positions, and the joint with that unit."""
    scale, unit = in_reader_units(1.0, "m" if body.types[column] == "P" else "rad")
    return scale, f"joint {body.joints[column]} [{unit}]"


def _loops(evidence: Evidence, x: FloatArray, y: FloatArray, column: int) -> list[Series]:
    series = []
    for direction, role, name in DIRECTIONS:
        rows = np.flatnonzero(evidence.test & (evidence.direction[:, column] * direction > 0.5) & np.isfinite(y))
        if len(rows):
            shown = rows[evenly_spaced(len(rows), MOST_POINTS)]
            series.append(Series(name, Mark.DOTS, role, x[shown], y[shown], size=2.0))
            along = rows[np.argsort(x[rows], kind="stable")]
            cells = np.array_split(along, min(BINS, max(1, len(rows) // 10)))  # of equally many points
            middle_x, middle_y = (np.array([np.median(values[cell]) for cell in cells]) for values in (x, y))
            series.append(Series(name, Mark.LINE, role, middle_x, middle_y))
    return series


def _most_explaining(evidence: Evidence, index: int) -> int:
    """Return the joint column whose deciles explain most of a channel's residual."""
    good = np.isfinite(evidence.before[:, index])
    residual = evidence.before[good, index]

    def _explained(position: FloatArray) -> float:
        edges = np.unique(np.quantile(position, np.linspace(0, 1, 11)))
        if len(edges) < 3:
            return 0.0
        count, total = (np.histogram(position, edges, weights=w)[0] for w in (np.ones(len(residual)), residual))
        return float((count * (total / np.maximum(count, 1) - residual.mean()) ** 2).sum())

    return int(np.argmax([_explained(column) for column in evidence.motor[good].T]))


def _limits(values: FloatArray) -> tuple[float, float]:
    """Both panels on one scale, a few outliers left outside."""
    low, high = np.clip(np.nanpercentile(values, [0.5, 99.5]), (-np.inf, 0.0), (0.0, np.inf))
    margin = 0.08 * (high - low) + 1e-12
    return float(low - margin), float(high + margin)


def map_chart(evidence: Evidence, index: int, channel: Channel, body: Body) -> Chart:
    """Return the mean residual of a channel over its own joint and the one that spreads it most, before and after.

    Parameters
    ----------
    evidence : Evidence, condensed rows; all parts are drawn
    index : int, column of the channel
    channel : Channel
    body : Body, for the joints' numbers and types
    """
    pair = _pair(evidence, index)
    scale, symbol = in_reader_units(1.0, channel.unit)
    means = [scale * _mean_map(evidence, values[:, index], pair) for values in (evidence.before, evidence.after)]
    largest = float(np.nanmax(np.abs(means[0]))) if np.isfinite(means[0]).any() else 1.0
    (along, one), (across, other) = (_axis(body, column) for column in pair)
    columns, rows = along * _edges(evidence.motor[:, pair[0]]), across * _edges(evidence.motor[:, pair[1]])
    i, j = (grid.ravel() for grid in np.indices(means[0].shape))
    x, x2, y, y2 = columns[i], columns[i + 1], rows[j], rows[j + 1]
    panels = []
    for title, mean in zip(STATES, means, strict=True):
        cells = Series(symbol, Mark.CELLS, Role.RAW, x, y, x2=x2, y2=y2, value=mean.ravel())
        panels.append(Panel(one, other, [cells], title=title, largest=largest, height=280))
    caption = (
        f"Mean of measured minus simulated, {channel_words(channel)}, over the joints that spread it most: orange "
        f"above zero, blue below, in full colour from {largest:.3g} {symbol}."
    )
    return Chart(caption, panels, columns=2)


def _edges(values: FloatArray) -> FloatArray:
    """Even edges over the bulk of the values."""
    low, high = np.percentile(values, [1, 99])
    return np.linspace(low, max(high, low + 1e-9), CELLS + 1)


def _mean_map(evidence: Evidence, values: FloatArray, pair: tuple[int, int]) -> FloatArray:
    """Means `(CELLS, CELLS)`; NaN where there are too few rows."""
    good = np.isfinite(values)
    x, y = (evidence.motor[good, j] for j in pair)
    edges = [_edges(evidence.motor[:, j]) for j in pair]
    count, total = (np.histogram2d(x, y, edges, weights=w)[0] for w in (None, values[good]))
    return np.where(count >= FEWEST, total / np.maximum(count, 1), np.nan)


def _pair(evidence: Evidence, index: int) -> tuple[int, int]:
    """Columns of the two joints whose cells explain most of the residual; a channel's own joint is the first."""
    n, own = evidence.motor.shape[1], evidence.joint[index]
    pairs = [p for p in combinations(range(n), 2) if own < 0 or own in p]
    if not pairs:
        return 0, 0

    def _between(pair: tuple[int, int]) -> float:
        image = _mean_map(evidence, evidence.before[:, index], pair)
        return float(np.nanvar(image)) if np.isfinite(image).sum() > 1 else 0.0

    best = max(pairs, key=_between)
    return best if own < 0 or best[0] == own else (best[1], best[0])
