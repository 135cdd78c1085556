"""The page of `gpcorrect discrepancy run`: the verdict, then where, what, how much, and what to record next."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gpcorrect.discrepancy.evidence.localise import Finding
from gpcorrect.discrepancy.naming.posterior import Level
from gpcorrect.discrepancy.outcome.result import DiscrepancyResult, NamedEffect
from gpcorrect.discrepancy.outcome.sentences import VISIBLE, next_step, short_words, steps_words, verdict_sentences
from gpcorrect.discrepancy.outcome.words import (
    MEANING,
    channel_words,
    estimate_words,
    noise_source_words,
    number,
    place,
    region_words,
    size_words,
    variable_words,
)
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.settings import ADVICE, NAMING, TESTS, VERDICT
from gpcorrect.report.discrepancy_charts import (
    gap_chart,
    likeness_chart,
    loop_chart,
    map_chart,
    posterior_chart,
    waterfall_chart,
)
from gpcorrect.report.page import Page, Section, TableData, write_page
from gpcorrect.sim import machine_of

MOST_CHANNELS = 6  # with a loop plot
MOST_MAPS = 2
MOST_FINDINGS = 10
MOST_LABELS = 14  # in the correlation matrix


def write_discrepancy_report(result: DiscrepancyResult, path: Path) -> None:
    """Write the self-contained page of a run; raises as :func:`write_page`.

    Parameters
    ----------
    result : DiscrepancyResult
    path : Path
    """
    source, (headline, *beside) = result.provenance, verdict_sentences(result)
    loops = loop_chart(result.evidence, _worst(result)[:MOST_CHANNELS], machine_of(result.model).body)
    sections = [
        _glance(result),
        _where(result),
        _what(result),
        _how_much(result),
        Section("Residual against position, by direction of travel", (), (), (loops,)),
        _search(result),
        _next(result),
        _not_nameable(result),
        _assumed(result),
    ]
    page = Page(
        "gpcorrect discrepancy",
        headline,
        [
            *(("and" if k else "also", sentence) for k, sentence in enumerate(beside)),
            ("verdict", f"{result.level}: {MEANING[result.level]}"),
            ("next", next_step(result)),
            ("recording", f"{source.name}, {source.rows} samples"),
            ("run", f"{source.seconds:.0f} s, seed {source.seed}"),
        ],
        [section for section in sections if section is not None],
        [("recording", f"{source.name}, SHA-256 {source.sha256 or 'none: not a file'}")],
    )
    write_page(page, path)


def _glance(result: DiscrepancyResult) -> Section | None:
    """Every joint, and the tool: what was missing, what is left, what it is called; the largest rest first."""
    rows = []
    for v in result.verdict.places:
        sizes = _sizes(v.gap.channel, v.gap.before, v.gap.after, v.gap.noise)
        names = [*map(short_words, v.effects), *(f"acts like {short_words(e)}" for e in v.alike)]
        left = f"{v.remaining:.2g} times the noise" if v.remaining else "none"
        rows.append([place(v.place), str(v.level), *sizes, left, ", ".join(names) or "–"])
    if not rows:
        return None
    head = ["where", "verdict", "before", "after", "noise", "left unexplained", "named there"]
    note = "Root mean squares of the test set, in the channel that was farthest off."
    return Section("At a glance", (), (TableData(head, rows, note, (1, 6)),))


def _where(result: DiscrepancyResult) -> Section:
    found = result.localisation.findings
    limit = result.localisation.threshold
    if not found:
        words = [f"None of the tests beats {limit:.1f} nats, the 99 % quantile of the largest of all tests in noise."]
        for e in (result.remainder or result.localisation).equivalence:
            bound = f"{100 * e.upper:.0f} % of the noise (95 % bound; {100 * TESTS.equivalence:.0f} % was asked for)"
            if np.isfinite(e.upper):
                words.append(f"{_capital(channel_words(e.channel))}: a systematic part is below {bound}.")
        return Section("Where", words)
    words = [
        "Measured minus simulated, before anything was added, depends on these variables. Gains are log Bayes factors "
        "in nats, on whole trajectories that the test had not seen (5 nats are odds of 150 to 1); noise alone stays "
        f"below {limit:.1f} nats in 99 of 100 recordings, the largest of all tests included."
    ]
    rows = [
        [channel_words(f.channel), _depends(f), region_words(f.region), _nats(f.nats)] for f in found[:MOST_FINDINGS]
    ]
    table = TableData(["channel", "depends on", "most at", "nats"], rows, text=(1, 2))
    if not found[0].counts:
        words.append(
            "All of these are in paths that the motors' encoders report, and below "
            f"{100 * TESTS.equivalence:.0f} % of the noise of the sensors outside: they do not matter, and count only "
            "where an effect explains them."
        )
    if result.effects and result.remainder is not None and (left := result.remainder.findings):
        count = "1 test still beats" if len(left) == 1 else f"{len(left)} tests still beat"
        strongest = f"{channel_words(left[0].channel)} over {_depends(left[0])} ({left[0].nats:.0f} nats)"
        words.append(f"After the named effects, {count} noise, the strongest {strongest}.")
    elif result.effects:
        words.append("After the named effects, no test of the motions that they were fitted to beats noise.")
    machine = machine_of(result.model).body
    figures = [map_chart(result.evidence, i, channel, machine) for i, channel in _worst(result)[:MOST_MAPS]]
    return Section("Where", words, (table,), figures)


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def _nats(value: float) -> str:
    return f"{value:,.0f}".replace(",", " ")


def _depends(finding: Finding) -> str:
    return " and ".join(variable_words(s.variable) for s in finding.region)


def _worst(result: DiscrepancyResult) -> list[tuple[int, Channel]]:
    """Channels with something to see, with their columns.

    The largest gap over its noise first; where no gap is to be seen, those in which the tests found something.
    """
    seen = [(i, g) for i, g in enumerate(result.gap) if np.isfinite(g.before) and g.noise]
    found = {f.channel for f in result.localisation.findings}
    seen.sort(key=lambda entry: -entry[1].before / entry[1].noise)
    worth = [(i, g.channel) for i, g in seen if g.before > VISIBLE * g.noise]
    in_tests = [(i, g.channel) for i, g in seen if g.channel in found]
    return worth or in_tests or [(i, g.channel) for i, g in seen[:1]]


def _what(result: DiscrepancyResult) -> Section | None:
    effects, unnamed, minor, alike = result.effects, result.not_named, result.verdict.minor, result.verdict.alike
    if not (effects or unnamed or minor or alike or result.verdict.of_steps):
        return None
    words = [
        "What is missing in the model, and what else could stand in its place. The bars are posterior probabilities; "
        '"nothing" and "unknown", a smooth part outside the catalogue, always compete.'
    ]
    tables = [_effect_table(effects)] if effects else []
    if minor:
        words.append(f"Minor, and not in the model: {', '.join(map(_title, minor))}.")
    if result.verdict.of_steps:
        differ = "two programs that step one servo each in its own way differ by as much"
        words.append(f"In the model, and no name, for {differ}: {steps_words(result)}.")
    if alike:
        words.append(
            "What the machine acts like is in the model, for it closes a gap, and is no name: but for friction, what a "
            f"machine is has one size in every motion (to within {100 * NAMING.constant:.0f} %), and where it shows it "
            f"closes {100 * VERDICT.whole:.0f} % of the gap, or all but noise."
        )
        rows = []
        for e in alike:
            shares = (f"{100 * v:.0f} %" for v in (e.spread, e.closes))
            rows.append([_title(e), str(e.level), _nats(e.nats), *shares, number(e.size)])
        head = ["acts like", "level of its shape", "nats", "size differs by", "gap closed", "over the noise"]
        tables.append(TableData(head, rows, text=(1,)))
    if unnamed:
        rows = [[u.label, str(u.level), _nats(u.nats), "; ".join(u.reasons) or "–"] for u in unnamed]
        tables.append(TableData(["helped in the search, but is not named", "level", "nats", "why"], rows, text=(1, 3)))
    bars = [(_title(e), e.alternatives) for e in effects]
    figures = [posterior_chart(bars)] if bars else []
    return Section("What", words, tables, figures)


def _title(effect: NamedEffect) -> str:
    return f"{place(effect.joint)}: {effect.name.replace('_', ' ')}"


def _effect_table(effects: Sequence[NamedEffect]) -> TableData:
    rows = [
        [
            _title(e),
            e.family,
            str(e.level),
            f"{e.probability:.3f}",
            ", ".join(f"{name} {estimate_words(p)}" for name, p in e.parameters.items()),
            ", ".join(f"{r.name.replace('_', ' ')} ({place(r.joint)})" for r in e.rivals) or "none",
            _nats(e.nats),
            f"{number(e.size)}{', minor' if e.is_minor else ''}" if np.isfinite(e.size) else "–",
        ]
        for e in effects
    ]
    head = ["effect", "class", "level", "probability", "numbers (95 % interval)", "rivals", "nats", "over the noise"]
    note = (
        "Nats: log Bayes factor on held-out trajectories. Over the noise: root mean square of what it changes; below "
        f"{TESTS.equivalence:g} an effect is minor."
    )
    return TableData(head, rows, note, (1, 2, 4, 5))


def _how_much(result: DiscrepancyResult) -> Section:
    words = [
        "On the test set, which nothing was fitted to (but the instant of a slip, where the rest leaves it open). "
        "Closed: 1 - (after² - noise²) / (before² - noise²). The black box is a Gaussian process on the same inputs: "
        "what can be explained without a name. The permutation control is the same fit to exchanged trajectories."
    ]
    head = ["channel", "before", "after", "noise", "closed", "95 % interval", "black box", "permutation control"]
    tail_head = ["channel", "95 %, before", "95 %, after", "maximum, before", "maximum, after"]
    rows, tails = [], []
    for g in result.gap:
        name, sizes = channel_words(g.channel), _sizes(g.channel, g.before, g.after, g.noise)
        closed, *ends = (_fraction(min(c, 1.0)) for c in (g.closed, *g.closed_ci95))
        controls = _fraction(g.black_box_ceiling), _fraction(g.permutation_control)
        rows.append([name, *sizes, closed, " to ".join(ends), *controls])
        tails.append([name, *_sizes(g.channel, *g.p95, *g.largest)])
    tables = (
        TableData(head, rows, "Root mean squares; intervals by drawing whole trajectories."),
        TableData(tail_head, tails, "Sizes that 95 % of the samples stay below, and the largest."),
    )
    return Section("How much", words, tables, (gap_chart(result.gap),))


def _sizes(channel: Channel, *values: float) -> list[str]:
    return [size_words(value, channel.unit) for value in values]


def _fraction(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{100 * value:.0f} %" if value > -1 else "< -100 %"


def _search(result: DiscrepancyResult) -> Section | None:
    evidence = result.evidence
    if not evidence.waterfall:
        return None
    figures = [waterfall_chart(evidence.waterfall)]
    if len(evidence.labels) > 1:
        part = min(len(evidence.labels), MOST_LABELS)
        figures.append(likeness_chart(evidence.correlation[:part, :part], evidence.labels[:part]))
    return Section("How the search went", (), (), figures)


def _next(result: DiscrepancyResult) -> Section:
    title, experiment = "What to record next", result.next_experiment
    if experiment is None and result.level in (Level.EXACT, Level.NONE):
        return Section(title, ["Nothing is left to tell apart."])
    if experiment is None:
        return Section(title, ["No two names compete: more trajectories, or another outside signal."])
    first, second = experiment.separates
    gain = (
        f"It should bring {experiment.expected_nats:.0f} nats between {first} and {second}, the rival refitted, in "
        f"{experiment.minutes:.1f} minutes."
        if experiment.decisive
        else f"The best run of all would bring {experiment.expected_nats:.1f} nats between {first} and {second}; "
        f"{ADVICE.enough:g} are needed."
    )
    return Section(title, [f"{_capital(experiment.run)}.", gain])


def _assumed(result: DiscrepancyResult) -> Section:
    rows = []
    for channel in (g.channel for g in result.gap):
        noise = result.provenance.noise[channel.name]
        tail = f"Student t, {noise.tail:.1f}" if np.isfinite(noise.tail) else "normal"
        parts = [*_sizes(channel, noise.white, noise.slow), f"{number(noise.time_constant)} s", tail]
        rows.append([channel_words(channel), *parts, noise_source_words(noise)])
    head = ["channel", "white", "slow", "time constant", "tails", "taken from"]
    tables = [TableData(head, rows, "Noise of each channel.", (4, 5))]
    return Section("What was assumed", [f"{_capital(r)}." for r in result.provenance.remarks], tables)


def _not_nameable(result: DiscrepancyResult) -> Section | None:
    """Effects that these data cannot show: their absence from the verdict says nothing."""
    lacks = result.provenance.not_nameable
    if not lacks:
        return None
    by_reason: dict[str, list[str]] = {}
    for lack in lacks:
        by_reason.setdefault(lack.why, []).append(lack.effect.replace("_", " "))
    rows = [[", ".join(effects), why] for why, effects in by_reason.items()]
    count = "one effect" if len(lacks) == 1 else f"{len(lacks)} effects"
    words = [f"Of the catalogue, {count} cannot be named from these data, whether they are there or not."]
    return Section("What these data cannot show", words, (TableData(["effects", "because"], rows, "", (0, 1)),))
