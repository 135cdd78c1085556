"""Checks of what is there at all: missing values, signals that never change, copies of other signals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding, Severity, examples
from gpcorrect.logs.checks.measure import runs

__all__ = ["Constant", "Loopback", "Missing", "Purpose"]

MANY_MISSING = 0.1  # of the samples: more than an occlusion now and then
COPIED = 0.99  # of the samples equal to the last bit: two sensors never agree so well
PAIRS = (
    ("measured_cp", "setpoint_cp"),
    ("measured_jp", "setpoint_jp"),
    ("tracker_cp", "setpoint_cp"),
    ("tracker_cp", "measured_cp"),
    ("external_jp", "setpoint_jp"),
    ("external_jp", "measured_jp"),
)
OUTSIDE = ("tracker_cp", "external_jp")


@dataclass(frozen=True)
class Purpose:
    """A log to learn from holds what was commanded and what came of it."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield which of the two is absent."""
        if not any(evidence.has(name) for name in ("setpoint_cp", "setpoint_jp")):
            what = "there is no command (setpoint_cp or setpoint_jp)."
            yield Finding("warning", "no_command", "", what, "A correction of the command cannot be learned from it.")
        if not any(evidence.has(name) for name in OUTSIDE):
            what = "there is no outside measurement (tracker_cp or external_jp)."
            hint = "What the robot reports goes through the same wrong model; record a tracker as well."
            yield Finding("warning", "no_observation", "", what, hint)


@dataclass(frozen=True)
class Missing:
    """Samples in which a signal has no value."""

    many: float = MANY_MISSING

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding for each signal with missing samples."""
        for name in evidence.log.signals:
            lost = ~evidence.known(name)
            rows = np.flatnonzero(lost)
            if not rows.size:
                continue
            share = rows.size / len(lost)
            severity: Severity = "error" if share == 1.0 else "warning" if share > self.many else "info"
            longest = int(np.diff(runs(lost), axis=1).max())
            what = f"{rows.size} of {len(lost)} samples ({share:.1%}) are missing, at most {longest} in a row."
            yield Finding(severity, "missing", name, what, "", int(rows.size), examples(rows))


@dataclass(frozen=True)
class Constant:
    """Motion signals that never change."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield an error where the robot moved and the signal does not say so, else a warning."""
        motions = [n for n in (*evidence.log.POSES, *evidence.log.JOINTS) if evidence.has(n)]
        still = [n for n in motions if _still(evidence, n)]
        for name in still:
            others = [n for n in motions if n not in still and n.rsplit("_")[-1] == name.rsplit("_")[-1]]
            severity: Severity = "error" if others else "warning"
            also = f", while {others[0]} does" if others else ""
            yield Finding(severity, "constant", name, f"it never changes{also}.", "", len(evidence.log))


def _still(evidence: Evidence, name: str) -> bool:
    table = evidence.table(name)[evidence.known(name)]
    return len(table) > 1 and bool((table == table[0]).all())


@dataclass(frozen=True)
class Loopback:
    """Signals of different sources must differ: no sensor repeats a command to the last bit."""

    share: float = COPIED

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding for each signal that is a copy of another one."""
        for name, source in PAIRS:
            if not (evidence.has(name) and evidence.has(source)) or _still(evidence, name):
                continue
            a, b = evidence.table(name), evidence.table(source)
            columns = min(a.shape[1], b.shape[1])
            both = evidence.known(name) & evidence.known(source)
            same = (a[both, :columns] == b[both, :columns]).all(axis=1)
            if same.size and same.mean() > self.share:
                severity: Severity = "error" if name in OUTSIDE else "warning"
                what = f"it is a copy of {source} in {same.mean():.1%} of the samples: nothing was measured."
                yield Finding(severity, "loopback", name, what, "", int(same.sum()))
