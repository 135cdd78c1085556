"""Checks of the time column: order, rate, gaps, unit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding, examples
from gpcorrect.logs.checks.measure import extent, step_lengths
from gpcorrect.logs.streams import GAP_STEPS
from gpcorrect.types import IntArray

__all__ = ["Gaps", "Jitter", "Stamps", "TimeUnit"]

MAX_JITTER = 0.25  # of the median step, between the 5th and 95th percentile: real clocks stay well below
LONGEST_STEP = 600.0  # s; no one records a motion at a sample in ten minutes
EPOCH_UNITS = ((1e17, "nanoseconds", 1e-9), (1e14, "microseconds", 1e-6), (1e11, "milliseconds", 1e-3))
STEP_UNITS = ((2e5, "nanoseconds", 1e-9), (LONGEST_STEP, "microseconds", 1e-6))
SLOWEST_MILLISECOND = 0.5  # steps of 0.5 to 100, read as seconds, are 2000 to 10 Hz in milliseconds
FASTEST_CREEP = 5e-4  # m/s; a robot that was recorded moving is faster at times
MIN_TRAVEL = 5e-3  # m; below it nothing is said about speeds


@dataclass(frozen=True)
class Stamps:
    """Time must be there and must increase inside a trajectory."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield missing, repeated and backward stamps, or that there is no clock."""
        if evidence.log.static:
            yield Finding("info", "static", "time", "static poses, no clock: nothing is said of times and speeds.")
        missing = np.flatnonzero(~np.isfinite(evidence.log.time))
        repeated, backward = np.flatnonzero(evidence.steps == 0), np.flatnonzero(evidence.steps < 0)
        if missing.size:
            yield _stamp("stamp_missing", f"{missing.size} samples have no time.", missing)
        if repeated.size:
            what = f"{repeated.size} samples have the time of the sample before."
            yield _stamp("stamp_repeated", what, repeated)
        if backward.size:
            most = -float(np.min(evidence.steps[backward]))
            what = f"{backward.size} samples are earlier than the one before, by up to {most:.3g} s."
            yield _stamp("stamp_backward", what, backward)


def _stamp(code: str, message: str, rows: IntArray) -> Finding:
    hint = (
        "Leave them out (--drop-disordered; in Python disorder='drop'), or give each motion its own trajectory number."
    )
    return Finding("error", code, "time", message, hint, len(rows), examples(rows))


@dataclass(frozen=True)
class Gaps:
    """Pauses of the recording, by the rule that velocities and interpolation also break at."""

    factor: float = GAP_STEPS

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield one finding for all gaps."""
        rows = np.array([r for _, part in evidence.log.trajectories() for r in self._gaps(evidence, part)], int)
        if rows.size:
            longest = float(evidence.steps[rows].max())
            yield Finding(
                "warning",
                "gap",
                "time",
                f"{rows.size} pauses of more than {self.factor:g} median steps, the longest {longest:.3g} s.",
                "No velocity or interpolation is taken across them.",
                int(rows.size),
                examples(rows),
            )

    def _gaps(self, evidence: Evidence, rows: IntArray) -> IntArray:
        step = evidence.steps[rows]
        forward = step[step > 0]
        found: IntArray = rows[step > self.factor * np.median(forward)] if forward.size else rows[:0]
        return found


@dataclass(frozen=True)
class Jitter:
    """How even the sampling is."""

    most: float = MAX_JITTER

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding where steps differ by more than a share of the median."""
        forward = evidence.steps[evidence.steps > 0]
        if forward.size < 10:
            return
        low, middle, high = np.percentile(forward, [5, 50, 95])
        if high - low > self.most * middle:
            yield Finding(
                "warning",
                "irregular",
                "time",
                f"it is irregular: 9 of 10 steps take {low:.3g} to {high:.3g} s, median {middle:.3g} s.",
                "They are used as they are: stamps should tell when a sample was taken, not when it came.",
                int(forward.size),
            )


@dataclass(frozen=True)
class TimeUnit:
    """Time should be in seconds."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a guess where seconds cannot be meant."""
        forward = evidence.steps[evidence.steps > 0]
        if not forward.size:
            return
        time, step = evidence.log.time[np.isfinite(evidence.log.time)], float(np.median(forward))
        guess = _by_size(float(np.median(np.abs(time))), step) or _milliseconds(evidence, step)
        if guess is not None:
            unit, scale = guess
            yield Finding(
                "error",
                "time_unit",
                "time",
                f"time looks like {unit}, not seconds: its median step is {step:.4g}.",
                f"Set time_scale = {scale:g} in the mapping file.",
                len(evidence.log),
            )


def _by_size(stamp: float, step: float) -> tuple[str, float] | None:
    """By the size of stamps since 1970, else by the size of steps."""
    for table, value in ((EPOCH_UNITS, stamp), (STEP_UNITS, step)):
        for limit, unit, scale in table:
            if value > limit and step >= 1.0:
                return unit, scale
    return None


def _milliseconds(evidence: Evidence, step: float) -> tuple[str, float] | None:
    """Guess milliseconds where the robot creeps between steps of seconds, though it covers a distance."""
    moving = [n for n in evidence.log.POSES if evidence.has(n) and extent(evidence.position(n)) > MIN_TRAVEL]
    if step < SLOWEST_MILLISECOND or not moving:
        return None
    fastest = max(_fastest(evidence, name) for name in moving)
    return ("milliseconds", 1e-3) if fastest < FASTEST_CREEP else None


def _fastest(evidence: Evidence, name: str) -> float:
    """99th percentile of the speed of a pose signal, m/s as time stands."""
    speed = step_lengths(evidence.log, evidence.position(name)) / np.where(evidence.steps > 0, evidence.steps, np.nan)
    known = speed[np.isfinite(speed)]
    return float(np.percentile(known, 99)) if known.size else np.inf
