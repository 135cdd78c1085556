"""The page of `gpcorrect discrepancy run`: the verdict, then where, what, how much, and what to record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gpcorrect import plots
from gpcorrect.discrepancy.advice.next_experiment import ENOUGH
from gpcorrect.discrepancy.evidence.localise import EQUIVALENCE
from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.words import (
    MEANING,
    VISIBLE,
    channel_words,
    in_reader_units,
    next_step,
    number,
    parameter_words,
    place,
    variable_words,
    verdict_sentence,
)
from gpcorrect.plots.discrepancy_gap import rms_at
from gpcorrect.report.page import FigureImage, Page, Section, TableData, write_page
from gpcorrect.sim import Model, machine_of

__all__ = ["write_discrepancy_report"]

MOST_CHANNELS = 6  # with a loop plot
MOST_MAPS = 2
MOST_FINDINGS = 10
MOST_LABELS = 14  # in the correlation matrix


def write_discrepancy_report(report: Mapping[str, Any], evidence: Evidence, model: Model, path: Path) -> None:
    """Write the self-contained page of a run.

    Parameters
    ----------
    report : mapping
        `Discrepancy.to_dict()`, or the same read back from report.json.
    evidence : Evidence
        What the figures are drawn from.
    model : Model
        For the joints' numbers and types.
    path : Path
        Page to write.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    write_page(_page(report, evidence, model), path)


def _page(report: Mapping[str, Any], evidence: Evidence, model: Model) -> Page:
    sections = [
        _where(report, evidence, model),
        _what(report),
        _how_much(report),
        _loops(report, evidence, model),
        _search(evidence),
        _next(report),
        _not_nameable(report),
        _assumed(report),
    ]
    return Page(
        "gpcorrect discrepancy", verdict_sentence(report), _facts(report), [s for s in sections if s is not None]
    )


def _facts(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    told = report["provenance"]
    data = [f"{d['name']}, {d['rows']} samples (SHA-256 {(d['sha256'] or 'not a file')[:16]})" for d in told["data"]]
    level = report["verdict"]["level"]
    return [
        ("verdict", f"{level}: {MEANING[level]}"),
        ("next", next_step(report)),
        *(("recording", words) for words in data),
        ("run", f"{told['seconds']:.0f} s, seed {told['seed']}"),
    ]


def _where(report: Mapping[str, Any], evidence: Evidence, model: Model) -> Section:
    found = report["localisation"]
    limit = report["provenance"]["thresholds"]["localisation_nats"]
    if not found:
        words = [f"None of the tests beats {limit:.1f} nats, the 99 % quantile of the luckiest test in noise."]
        return Section("Where", [*words, *_equivalence(report)])
    words = [
        "Measured minus simulated, before anything was added, depends on these variables. Gains are in nats, "
        "logarithms of likelihood on whole trajectories that the test had not seen (5 nats are odds of 150 to 1); "
        f"noise alone stays below {limit:.1f} nats in 99 of 100 recordings, the luckiest test included."
    ]
    rows = [
        [channel_words(f["channel"]), _depends(f), f["region"], f"{f['nats']:,.0f}".replace(",", " ")]
        for f in found[:MOST_FINDINGS]
    ]
    table = TableData(["channel", "depends on", "most at", "nats"], rows, text=(1, 2))
    if not found[0].get("counts", True):
        words.append(
            f"All of these are in paths that the motors' encoders report, and below {100 * EQUIVALENCE:.0f} % of the "
            "noise of the sensors outside: they do not matter, and count only where an effect explains them."
        )
    left = report["provenance"]["remainder"]
    after = "Nothing is left after the named effects." if not left else f"After the named effects, {_left(left)}."
    machine = machine_of(model).body
    figures = [
        FigureImage(
            plots.png(plots.residual_over_joints(evidence, i, unit, machine.joints, machine.types)),
            f"Mean of measured minus simulated, {channel_words(name)}, over the joints that spread it most.",
        )
        for i, name, unit in _worst(report)[:MOST_MAPS]
    ]
    words += [after] if report["verdict"]["effects"] else []
    return Section("Where", words, (table,), figures)


def _equivalence(report: Mapping[str, Any]) -> list[str]:
    return [
        f"{channel_words(e['channel'])[:1].upper()}{channel_words(e['channel'])[1:]}: a systematic part is below "
        f"{100 * e['systematic_upper']:.0f} % of the noise (95 % bound; {100 * e['limit']:.0f} % was asked for)."
        for e in report["provenance"]["equivalence"]
        if e["systematic_upper"] is not None
    ]


def _left(left: Sequence[Mapping[str, Any]]) -> str:
    first = left[0]
    where = f"{channel_words(first['channel'])} over {_depends(first)}"
    count = "1 test still beats" if len(left) == 1 else f"{len(left)} tests still beat"
    return f"{count} noise, the strongest {where} ({first['nats']:.0f} nats)"


def _depends(finding: Mapping[str, Any]) -> str:
    return " and ".join(map(variable_words, finding["variables"]))


def _worst(report: Mapping[str, Any]) -> list[tuple[int, str, str]]:
    """Channels with something to see, as (index, name, unit).

    The largest gap over its noise first; where no gap is to be seen, those in which the tests found something.
    """
    numbered = [(i, name, g) for i, (name, g) in enumerate(report["gap"].items())]
    seen = [(i, n, g) for i, n, g in numbered if g["before"] is not None and g["noise"]]
    found = [f["channel"] for f in report["localisation"]]
    seen.sort(key=lambda entry: -entry[2]["before"] / entry[2]["noise"])
    worth = [(i, n, g["unit"]) for i, n, g in seen if g["before"] > VISIBLE * g["noise"]]
    heard = [(i, n, g["unit"]) for i, n, g in seen if n in found]
    return worth or heard or [(i, n, g["unit"]) for i, n, g in seen[:1]]


def _what(report: Mapping[str, Any]) -> Section | None:
    effects, unnamed = report["verdict"]["effects"], report["provenance"]["not_named"]
    if not effects and not unnamed:
        return None
    words = [
        "What is missing in the model, and what else could stand in its place. The bars are posterior probabilities; "
        '"nothing" and "unknown", a smooth part outside the catalogue, always compete.'
    ]
    tables = [_effect_table(effects)] if effects else []
    if unnamed:
        rows = [[u["label"], u["level"], f"{u['nats']:.0f}", "; ".join(u["why"]) or "–"] for u in unnamed]
        tables.append(TableData(["helped in the search, but is not named", "level", "nats", "why"], rows, text=(1, 3)))
    bars = [(f"{place(e['joint'])}: {e['name'].replace('_', ' ')}", _alternatives(e)) for e in effects]
    figures = []
    if bars:
        caption = "What could stand in each effect's place. Grey: nothing, and anything outside the catalogue."
        figures = [FigureImage(plots.png(plots.posterior_bars(bars)), caption)]
    return Section("What", words, tables, figures)


def _effect_table(effects: Sequence[Mapping[str, Any]]) -> TableData:
    rows = [
        [
            f"{place(e['joint'])}: {e['name'].replace('_', ' ')}",
            e["class"],
            e["level"],
            f"{e['probability']:.3f}",
            ", ".join(f"{name} {parameter_words(p)}" for name, p in e["parameters"].items()),
            ", ".join(f"{r['name'].replace('_', ' ')} ({place(r['joint'])})" for r in e["rivals"]) or "none",
            f"{e['nats']:.0f}",
        ]
        for e in effects
    ]
    head = ["effect", "class", "level", "probability", "numbers (95 % interval)", "rivals", "nats"]
    return TableData(head, rows, "Nats: gain of log-likelihood on held-out trajectories.", (1, 2, 4, 5))


def _alternatives(effect: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    alternatives: Sequence[Mapping[str, Any]] = effect["alternatives"]
    return alternatives


def _how_much(report: Mapping[str, Any]) -> Section:
    words = [
        "On the sealed part, which nothing was fitted to. Closed: 1 - (after² - noise²) / (before² - noise²). The "
        "black box is a Gaussian process on the same inputs: what can be explained without a name. The placebo is the "
        "same fit to shuffled trajectories."
    ]
    rows = [_gap_row(name, gap) for name, gap in report["gap"].items()]
    head = ["channel", "before", "after", "noise", "closed", "95 % interval", "black box", "placebo"]
    tails = [_tail_row(name, gap) for name, gap in report["gap"].items()]
    tail_head = ["channel", "95 %, before", "95 %, after", "maximum, before", "maximum, after"]
    tables = (
        TableData(head, rows, "Root mean squares; intervals by drawing whole trajectories."),
        TableData(tail_head, tails, "Sizes that 95 % of the samples stay below, and the largest."),
    )
    caption = "Root mean squares: the grey line is what the named effects close."
    return Section("How much", words, tables, (FigureImage(plots.png(plots.gap_chart(report["gap"])), caption),))


def _gap_row(name: str, gap: Mapping[str, Any]) -> list[str]:
    scale, symbol = in_reader_units(1.0, gap["unit"])
    sizes = [_size(scale * rms_at(gap, key), symbol) for key in ("before", "after", "noise")]
    interval = " to ".join(_share(end) for end in gap["closed_ci95"])
    yardsticks = [_share(gap["black_box_ceiling"]), _share(gap["placebo"])]
    return [channel_words(name), *sizes, _share(gap["closed"]), interval, *yardsticks]


def _tail_row(name: str, gap: Mapping[str, Any]) -> list[str]:
    scale, symbol = in_reader_units(1.0, gap["unit"])
    sizes = [None if v is None else scale * v for v in (*gap["p95"], *gap["max"])]
    return [channel_words(name), *(_size(size, symbol) for size in sizes)]


def _size(value: float | None, symbol: str) -> str:
    return f"{number(value)}{'' if symbol == '°' else ' '}{symbol}"


def _share(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{100 * value:.0f} %" if value > -1 else "< -100 %"


def _loops(report: Mapping[str, Any], evidence: Evidence, model: Model) -> Section:
    shown = _worst(report)[:MOST_CHANNELS]
    figure = plots.loop_plots(evidence, shown, machine_of(model).body)
    caption = (
        "Sealed part. Two separate lines are a loop: play, friction or hysteresis; one bent line is geometry or load; "
        "a line at zero is explained. Lines are running medians."
    )
    return Section(
        "Residual against position, by direction of travel", (), (), (FigureImage(plots.png(figure), caption),)
    )


def _search(evidence: Evidence) -> Section | None:
    if not evidence.waterfall:
        return None
    caption = "Held-out nats of every step of the search; orange steps took an effect out again."
    figures = [FigureImage(plots.png(plots.nats_waterfall(evidence.waterfall)), caption)]
    n = len(evidence.labels)
    if n > 1:
        part = min(n, MOST_LABELS)
        matrix = plots.signature_correlation(evidence.correlation[:part, :part], evidence.labels[:part])
        likeness = "Likeness of the signatures as seen through the noise; near 1 or -1 two effects look the same here."
        figures.append(FigureImage(plots.png(matrix), likeness))
    return Section("How the search went", (), (), figures)


def _next(report: Mapping[str, Any]) -> Section:
    advice = report["next_experiment"]
    if advice is None:
        decided = report["verdict"]["level"] in ("EXACT", "NONE")
        words = (
            "Nothing is left to tell apart."
            if decided
            else "No two names compete: more trajectories, or another outside signal."
        )
        return Section("What to record next", [words])
    first, second = advice["separates"]
    words = f"{advice['run'][:1].upper()}{advice['run'][1:]}."
    nats = advice["expected_nats"]
    gain = (
        f"It should bring {nats:.0f} nats between {first} and {second}, the rival refitted, in "
        f"{advice['minutes']:.1f} minutes."
        if nats >= ENOUGH
        else f"The best run of all would bring {nats:.1f} nats between {first} and {second}; 3 are needed."
    )
    return Section("What to record next", [words, gain])


def _assumed(report: Mapping[str, Any]) -> Section:
    told = report["provenance"]
    rows = []
    for name, noise in told["noise"].items():
        scale, symbol = in_reader_units(1.0, report["gap"][name]["unit"])
        tail = "normal" if noise["tail"] is None else f"Student t, {noise['tail']:.1f}"
        sizes = [_size(scale * noise[part], symbol) for part in ("white", "slow")]
        rows.append([channel_words(name), *sizes, f"{number(noise['time_constant'])} s", tail, noise["basis"]])
    head = ["channel", "white", "slow", "time constant", "tails", "taken from"]
    tables = [TableData(head, rows, "Noise of each channel.", (4, 5))]
    return Section("What was assumed", [f"{r[:1].upper()}{r[1:]}." for r in told["remarks"]], tables)


def _not_nameable(report: Mapping[str, Any]) -> Section | None:
    """Effects that these data cannot show: their absence from the verdict says nothing."""
    lacks = report["provenance"]["not_nameable"]
    if not lacks:
        return None
    by_reason: dict[str, list[str]] = {}
    for lack in lacks:
        by_reason.setdefault(lack["why"], []).append(lack["effect"].replace("_", " "))
    rows = [[", ".join(effects), why] for why, effects in by_reason.items()]
    words = [f"Of the catalogue, {len(lacks)} effects cannot be named from these data, whether they are there or not."]
    return Section("What these data cannot show", words, (TableData(["effects", "because"], rows, "", (0, 1)),))
