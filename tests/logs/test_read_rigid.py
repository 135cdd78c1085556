"""Markers of a tool: which belong together, whether they are rigid, and what is said where they are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mocap_support import mapping, moving_tool

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import read_log, validate_log
from gpcorrect.logs.mocap.take import bodies_of, tool_poses
from gpcorrect.types import FloatArray


def write_markers(path: Path, labels: list[str], points: FloatArray) -> Path:
    """Write a TRC file of markers `(n, m, 3)` in metres at 100 Hz; NaN is an empty cell."""
    lines = ["PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tNumFrames\tNumMarkers\tUnits"]
    lines += [f"100\t{len(points)}\t{len(labels)}\tm", "Frame#\tTime\t" + "\t\t\t".join(labels)]
    lines += ["\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(len(labels)) for axis in "XYZ"), ""]
    for k, frame in enumerate(points):
        cells = ["" if np.isnan(x) else f"{x:.9f}" for x in frame.ravel()]
        lines.append("\t".join([str(k + 1), f"{k / 100:.2f}", *cells]))
    path.write_text("\n".join(lines) + "\n")
    return path


def two_tools() -> tuple[FloatArray, FloatArray]:
    """Markers of two tools that move differently."""
    return moving_tool(1, 600, ()).markers, moving_tool(2, 600, ()).markers


@pytest.mark.parametrize("form", ["{}:{}", "{}_{}", "{} - {}", "{}{}", "{}.{}"])
def test_labels_name_the_body(form: str):
    """However marker systems join body and number, the body is found; a label without a number names none."""
    names = [form.format(body, k) for body in ("left arm", "base") for k in (1, 2, 10)]
    assert bodies_of(names) == {"left arm": names[:3], "base": names[3:]}
    assert bodies_of(["top", "left", "17"]) == {"": ["top", "left", "17"]}


def test_two_labelled_bodies_are_never_one_tool(tmp_path: Path):
    """Without a choice it is refused and both are named; chosen by the name in the labels, it is that body alone."""
    arm, base = two_tools()
    names = [f"{body}{k}" for body in ("arm", "base") for k in range(5)]
    path = write_markers(tmp_path / "a.trc", names, np.concatenate([arm, base], axis=1))
    with pytest.raises(LogError, match=r"2 bodies: arm \(5 markers\), base \(5 markers\).*body = \"arm\""):
        read_log(path)
    log = read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "base"}))
    np.testing.assert_allclose(log.tracker_cp.position, base.mean(axis=1), atol=1e-8)
    with pytest.raises(LogError, match="Bodies here: arm, base"):
        read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "tool"}))


def test_the_only_body_that_gives_a_pose_is_the_tool(tmp_path: Path):
    """Single markers elsewhere are left out, by name."""
    arm, base = two_tools()
    names = [*(f"arm:{k}" for k in range(5)), "floor"]
    log = read_log(write_markers(tmp_path / "a.trc", names, np.concatenate([arm, base[:, :1]], axis=1)))
    np.testing.assert_allclose(log.tracker_cp.position, arm.mean(axis=1), atol=1e-8)
    assert "markers of other bodies are left out: floor." in log.remarks


def test_labels_of_many_bodies_on_one_rigid_tool_are_one_tool(tmp_path: Path):
    """What moves as one is one, whatever the labels say."""
    arm, _ = two_tools()
    rigid = np.concatenate([arm, arm[:, :1] + arm[:, 4:] - arm[:, 1:2]], axis=1)
    names = ["a1", "a2", "a3", "b1", "b2", "b3"]
    log = read_log(write_markers(tmp_path / "a.trc", names, rigid))
    np.testing.assert_allclose(log.tracker_cp.position, rigid.mean(axis=1), atol=1e-8)


def test_a_marker_that_moves_is_named_and_refused(tmp_path: Path):
    """One marker that moves 100 mm against the others: no tool."""
    arm, _ = two_tools()
    arm[:, 3] += 0.1 * np.sin(np.arange(len(arm)) / 30)[:, None] * [0.0, 0.0, 1.0]
    path = write_markers(tmp_path / "a.trc", ["top", "left", "right", "elbow", "tip"], arm)
    with pytest.raises(LogError, match=r"do not move as one rigid tool.* mm.*elbow moves most"):
        read_log(path)


def test_a_tool_that_bends_is_read_with_a_warning(tmp_path: Path):
    """Between one and ten millimetres the marker is named, and the dry run warns; below one nothing is said."""
    arm, _ = two_tools()
    bend = np.sin(np.arange(len(arm)) / 3)[:, None] * [0.0, 0.0, 1.0]
    for size, said in ((0.012, True), (0.0005, False)):
        moved = arm.copy()
        moved[:, 2] += size * bend
        log = read_log(write_markers(tmp_path / "a.trc", ["a", "b", "c", "d", "e"], moved))
        assert any("c moves most" in r for r in log.remarks) == said
        assert any(f.code == "marker_misfit" for f in validate_log(log, ["marker_misfit"]).findings) == said


def test_markers_never_seen_are_left_out_by_name(tmp_path: Path):
    """A label without a single sample is no reason to refuse the others."""
    arm, _ = two_tools()
    gone = np.concatenate([arm, np.full((len(arm), 2, 3), np.nan)], axis=1)
    names = [f"arm:{k}" for k in range(5)] + ["arm:lost", "arm:spare"]
    log = read_log(write_markers(tmp_path / "a.trc", names, gone))
    np.testing.assert_allclose(log.tracker_cp.position, arm.mean(axis=1), atol=1e-8)
    assert "markers that were never seen are left out: arm:lost, arm:spare." in log.remarks


def test_no_frame_need_show_all_markers():
    """Frames that share three markers tie the rest together; the origin is the centroid of all."""
    tool = moving_tool(3, 60, ())
    points = tool.markers.copy()
    points[::2, 4] = np.nan
    points[1::2, 3] = np.nan
    pose, rms = tool_poses(points)
    np.testing.assert_allclose(pose.position, tool.markers.mean(axis=1), atol=1e-9)
    assert rms.max() < 1e-9
    points[:, 4] = np.nan
    with pytest.raises(DataError, match="seen beside three others"):
        tool_poses(points)
