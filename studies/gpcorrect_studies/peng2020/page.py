"""The page of `gpcorrect reproduce peng2020`: the paper's table as printed, ours beside it, and the estimator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gpcorrect.report.page import Section, TableData
from gpcorrect_studies.claims_page import paired, setup_section, write_study_page
from gpcorrect_studies.peng2020.study import CLAIMS, COMPONENTS, Peng2020

NAMES = {"linear": "linear", "network": "network, the paper's", "gp": "ours (gp)"}
NOT_COMPARABLE = (
    "Pictures are rendered: blur, noise and clutter are in them, rolling shutters and cameras that are not "
    "synchronised are not; and the truth is known.",
    "The robot is simulated: how much of its error can be learned was our choice of parameters.",
    "Seconds: another computer and other libraries.",
)


def write_peng2020_report(result: Peng2020, path: Path) -> None:
    """Write the self-contained page; raises as :func:`write_study_page`.

    Parameters
    ----------
    result : Peng2020
    path : Path
    """
    network = result.estimator["network"]
    verdict = (
        f"The network takes away {network['rms_reduction']:.1f} % of the simulated robot's RMS error and "
        f"{network['sd_reduction']:.1f} % of its SD."
    )
    facts = [
        ("pictures", f"rendered, {result.scope.frames} frames of four webcams, seed {result.seed}"),
        (
            "robot",
            f"simulated RAVEN-II, {result.scope.reaches} reaches, {result.samples} samples, the last fifth held out",
        ),
        ("network", f"{'-'.join(map(str, result.scope.layers))}, {result.scope.epochs} epochs"),
    ]
    sections = [
        _table1(result),
        _estimator(result),
        setup_section(CLAIMS.setup, result.setup()),
        Section("What is not comparable", NOT_COMPARABLE),
    ]
    write_study_page(result, verdict, facts, sections, path)


def _table1(result: Peng2020) -> Section:
    printed, measured = (
        {
            name.removesuffix("_mm").replace("length", "3D"): [
                f"{row[name][leaf]:.4f}" for row in table.values() for leaf in ("rms", "sd")
            ]
            for name in COMPONENTS
        }
        for table in (CLAIMS.printed["table1"], result.table1)
    )
    turns = ", ".join(
        f"{name} {row['rotation_rms_deg']:.3f} deg" for name, row in result.table1.items() if "rotation_rms_deg" in row
    )
    words = [
        f"Cameras are calibrated from noisy corners and markers, and stand within {max(result.cameras_mm):.2f} mm of "
        f"where they truly are. RMS rotation, which the paper's table has not: {turns}."
    ]
    heads = [f"{name}, {leaf}" for name in result.table1 for leaf in ("RMS", "SD")]
    table = TableData(["mm", *heads], paired(measured, printed), "The last case, with a camera hidden, is ours.")
    return Section("Table I: measuring accuracy", words, (table,))


def _estimator(result: Peng2020) -> Section:
    rows = [
        [
            NAMES[method],
            *(f"{row[name]['rms_mm']:.3f}" for name in ("raw", "rigid", "estimated")),
            *(f"{row[name]:.1f} %" for name in ("rms_reduction", "sd_reduction")),
            f"{row['microseconds_a_sample']:.0f}",
        ]
        for method, row in result.estimator.items()
    ]
    printed = {claim.of: f"{CLAIMS.printed_number(claim):g} %" for claim in CLAIMS.claims}
    less = [printed[f"estimator/network/{name}"] for name in ("rms_reduction", "sd_reduction")]
    rows.append(["network, printed", "", "", "", *less, ""])
    heads = ["", "as reported", "rigid", "estimated", "RMS less by", "SD less by", "a sample [µs]"]
    note = "RMS of the tool's position on held-out reaches, mm. Linear and gp are ours."
    axes = [
        [
            NAMES[method],
            *(f"{row['estimated'][f'{leaf}_axes_mm'][k]:.3f}" for leaf in ("rms", "sd") for k in range(3)),
            *(_less(row, leaf, k) for leaf in ("rms", "sd") for k in range(3)),
        ]
        for method, row in result.estimator.items()
    ]
    names = [f"{leaf} {axis}" for leaf in ("RMS", "SD") for axis in "xyz"]
    by_axis = TableData(
        ["estimated, by axis", *(f"{name} [mm]" for name in names), *(f"{name} less by" for name in names)],
        axes,
        "Less than as reported.",
    )
    return Section("The estimator", (), (TableData(heads, rows, note), by_axis))


def _less(row: Mapping[str, Any], leaf: str, axis: int) -> str:
    before, after = (row[kind][f"{leaf}_axes_mm"][axis] for kind in ("raw", "estimated"))
    return f"{100 * (1 - after / before):.0f} %"
