from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from read_support import write
from scipy.spatial.transform import Rotation
from support import ROOT

from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.logs import read_log
from gpcorrect.logs.contents import contents_of
from gpcorrect.logs.mocap.take import configuration, tool_poses

sys.path.append(str(ROOT / "bench"))
from formats.c3d_bytes import write_c3d_bytes

BODY = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.07, 0], [0, 0, 0.05], [0.04, 0.05, 0.02]])
N = 40


def motion(seed: int, n: int = N) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations, positions of the centroid, and markers of a body that moves at random."""
    rng = np.random.default_rng(seed)
    turns, at = Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-0.3, 0.3, (n, 3))
    centred = BODY - BODY.mean(axis=0)
    return turns, at, np.einsum("nij,mj->nmi", turns, centred) + at[:, None]


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return Rotation.from_matrix(a @ b.swapaxes(-1, -2)).magnitude()


def matrices(quaternion: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_planted_motion_is_recovered_whatever_the_size_of_the_body(size: float):
    turns, at, points = motion(14)
    pose, rms = tool_poses(size * points)
    np.testing.assert_allclose(pose.position, size * at, atol=1e-12 * size)
    assert rms.max() < 1e-12 * size
    assert angle(matrices(pose.quaternion), turns @ turns[0].T).max() < 1e-7
    flat = size * (points[:, :1] + np.array([[0.0], [1.0], [3.0]]) * (points[:, 1:2] - points[:, :1]))
    with pytest.raises(DegenerateError, match="lie on a line"):
        tool_poses(flat)


def test_hidden_markers_do_not_matter_while_three_are_seen():
    turns, at, points = motion(2)
    points[5, 1], points[6, [0, 4]], points[7, [0, 1, 2]] = np.nan, np.nan, np.nan
    pose, rms = tool_poses(points)
    missing = np.isnan(pose.position).any(axis=1)
    assert np.flatnonzero(missing).tolist() == [7]
    np.testing.assert_array_equal(np.isnan(rms), missing)
    np.testing.assert_allclose(pose.position[~missing], at[~missing], atol=1e-12)
    assert angle(matrices(pose.quaternion[~missing]), (turns @ turns[0].T)[~missing]).max() < 1e-7


def test_the_median_configuration_shrugs_off_swapped_markers():
    _, _, points = motion(3)
    points[[4, 9, 17]] = points[[4, 9, 17]][:, [1, 0, 2, 3, 4]]
    body = configuration(points)
    np.testing.assert_allclose(body.mean(axis=0), 0, atol=1e-12)
    distance = np.linalg.norm(body[:, None] - body[None], axis=2)
    np.testing.assert_allclose(distance, np.linalg.norm(BODY[:, None] - BODY[None], axis=2), atol=1e-9)
    _, rms = tool_poses(points)
    assert set(np.flatnonzero(rms > 1e-3)) == {4, 9, 17}


def test_noise_of_the_markers_is_averaged_and_shows_in_the_rms():
    _, at, points = motion(4, n=400)
    noisy = points + np.random.default_rng(5).normal(scale=1e-4, size=points.shape)
    pose, rms = tool_poses(noisy)
    assert np.sqrt(((pose.position - at) ** 2).sum(axis=1).mean()) < 1e-4
    expected = 1e-4 * np.sqrt(3 * (15 - 6) / 15)  # a fit of 6 numbers to 15 leaves 9 degrees of freedom
    assert np.sqrt((rms**2).mean()) == pytest.approx(expected, rel=0.1)


def test_a_marker_that_is_never_seen_is_refused():
    _, _, points = motion(7)
    points[:, 1] = np.nan
    with pytest.raises(DataError, match="seen in 100%, 0%, 100%"):
        tool_poses(points)


def write_c3d(path: Path, points: np.ndarray, labels: list[str], unit: str = "mm", rate: float = 100.0) -> Path:
    """Write markers (n, m, 3) in the file's unit; NaN is a hidden marker."""
    import ezc3d

    c3d = ezc3d.c3d()
    c3d["parameters"]["POINT"]["RATE"]["value"] = [rate]
    c3d["parameters"]["POINT"]["LABELS"]["value"] = tuple(labels)
    c3d["parameters"]["POINT"]["UNITS"]["value"] = [unit] if unit else []
    hidden = np.isnan(points).any(axis=2)
    data = np.ones((4, points.shape[1], len(points)))
    data[:3] = np.moveaxis(np.where(hidden[..., None], 0.0, points), 2, 0).swapaxes(1, 2)
    c3d["data"]["points"] = data
    c3d["data"]["meta_points"]["residuals"] = np.where(hidden, -1.0, 0.0).T[None]
    c3d["data"]["meta_points"]["camera_masks"] = np.zeros((7, points.shape[1], len(points)), dtype=bool)
    c3d.write(str(path))
    return path


LABELS = ["A", "B", "C", "D", "E"]


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e3), ("m", 1.0), ("cm", 1e2), ("", 1e3)])
def test_a_recording_is_read_in_metres_at_its_rate(tmp_path: Path, unit: str, scale: float):
    turns, at, points = motion(8)
    log = read_log(write_c3d(tmp_path / "a.c3d", points * scale, LABELS, unit, 250.0))
    np.testing.assert_allclose(np.diff(log.time), 1 / 250, atol=1e-12)
    np.testing.assert_allclose(log.tracker_cp.position, at, atol=1e-6)
    assert angle(matrices(log.tracker_cp.quaternion), turns @ turns[0].T).max() < 1e-4
    assert log.extra["marker_rms"].max() < 1e-6
    assert any("millimetres were assumed" in r for r in log.remarks) == (unit == "")


def test_a_negative_residual_hides_a_marker(tmp_path: Path):
    _, at, points = motion(9)
    points[3, [0, 1, 2]] = np.nan
    points[4, 0] = np.nan
    log = read_log(write_c3d(tmp_path / "a.c3d", points * 1e3, LABELS))
    assert np.flatnonzero(np.isnan(log.tracker_cp.position[:, 0])).tolist() == [3]
    np.testing.assert_allclose(log.tracker_cp.position[4], at[4], atol=1e-6)


def test_the_mapping_says_which_markers_are_on_the_tool(tmp_path: Path):
    _, _, points = motion(10)
    far = np.concatenate([points, np.random.default_rng(0).normal(size=(N, 1, 3))], axis=1)
    path = write_c3d(tmp_path / "a.c3d", far * 1e3, [*LABELS, "bench"])
    mapping = write(tmp_path / "m.toml", '[mocap]\nmarkers = ["E", "A", "C"]\n')
    log = read_log(path, columns=mapping)
    np.testing.assert_allclose(log.tracker_cp.position, points[:, [4, 0, 2]].mean(axis=1), atol=1e-6)
    assert log.remarks == ("tracker_cp was computed from the markers E, A, C.",)
    one = read_log(path, columns=write(tmp_path / "one.toml", '[mocap]\nmarkers = ["B"]\n'))
    assert one.tracker_cp.quaternion is None
    np.testing.assert_allclose(one.tracker_cp.position, points[:, 1], atol=1e-6)
    with pytest.raises(LogError, match=r"there is no marker Z\. Markers here: A, B, C, D, E, bench"):
        read_log(path, columns=write(tmp_path / "z.toml", '[mocap]\nmarkers = ["A", "Z"]\n'))


def test_its_markers_are_listed_before_any_is_chosen(tmp_path: Path):
    points = np.random.default_rng(6).normal(size=(5, 3, 3))
    found = contents_of(write_c3d(tmp_path / "a.c3d", points, ["tip", "left", "right"]))
    assert [(part.name, part.kind, part.samples) for part in found.parts] == [
        (name, "marker", 5) for name in ("tip", "left", "right")
    ]
    assert found.mapping == '[mocap]\nmarkers = ["tip", "left", "right"]\n'


def test_bad_recordings_are_refused(tmp_path: Path):
    _, _, points = motion(11)
    with pytest.raises(LogError, match="positions are in 'inch'"):
        read_log(write_c3d(tmp_path / "inch.c3d", points, LABELS, "inch"))
    with pytest.raises(LogError, match=r"two\.c3d: two markers give no orientation"):
        read_log(write_c3d(tmp_path / "two.c3d", points[:, :2], LABELS[:2]))
    with pytest.raises(LogError, match="does not begin like a C3D file"):
        read_log(write(tmp_path / "text.c3d", "time,payload\n" * 100))
    with pytest.raises(LogError, match="the file is empty"):
        read_log(write(tmp_path / "empty.c3d", b""))


def test_a_recording_cut_off_anywhere_is_refused(tmp_path: Path):
    whole = write_c3d(tmp_path / "a.c3d", motion(12)[2] * 1e3, LABELS).read_bytes()
    used = len(whole.rstrip(b"\0"))
    for size in np.linspace(1, used - 600, 8).astype(int):
        with pytest.raises(LogError, match=r"cut off|does not begin"):
            read_log(write(tmp_path / "cut.c3d", whole[:size]))


@pytest.mark.parametrize("order", ["intel", "dec", "mips"])
def test_every_order_of_bytes_and_labels_beyond_the_points_are_read(tmp_path: Path, order: str):
    """Files written byte by byte. Cut off, they are refused."""
    _, at, points = motion(16)
    points[3] = np.nan
    path = write_c3d_bytes(tmp_path / "a.c3d", 1e3 * points, [*LABELS, "spare", "none"], 125.0, order)
    log = read_log(path)
    np.testing.assert_allclose(np.delete(log.tracker_cp.position, 3, axis=0), np.delete(at, 3, axis=0), atol=1e-6)
    assert np.isnan(log.tracker_cp.position[3]).all()
    np.testing.assert_allclose(np.diff(log.time), 1 / 125)
    whole = path.read_bytes()
    with pytest.raises(LogError, match="cut off"):
        read_log(write(tmp_path / "cut.c3d", whole[: len(whole) - 1024]))


@pytest.mark.parametrize("order", ["intel", "dec", "mips"])
@pytest.mark.parametrize("scale", [-1.0, 0.02])
def test_integers_and_real_numbers_hold_the_same_places(tmp_path: Path, order: str, scale: float):
    """Integers count steps of the scale, here 0.02 mm: they are half of it off at most."""
    _, at, points = motion(17)
    points[5] = np.nan
    log = read_log(write_c3d_bytes(tmp_path / "a.c3d", 1e3 * points, LABELS, 125.0, order, scale))
    np.testing.assert_allclose(np.delete(log.tracker_cp.position, 5, axis=0), np.delete(at, 5, axis=0), atol=1e-5)
    assert np.isnan(log.tracker_cp.position[5]).all()


@pytest.mark.parametrize("n", [65535, 65536, 140000])
@pytest.mark.parametrize(("order", "long"), [("intel", ""), ("dec", "trial"), ("mips", "trial"), ("intel", "point")])
def test_every_frame_of_a_long_recording_is_read(tmp_path: Path, n: int, order: str, long: str):
    """The header counts to 65535; what is beyond is stated in one of two ways, or in none. ezc3d reads no further."""
    path = 0.05 * np.random.default_rng(n).uniform(-1, 1, (n, 3)).cumsum(axis=0) / np.sqrt(n)
    file = write_c3d_bytes(tmp_path / "a.c3d", 1e3 * path[:, None], ["tip"], 100.0, order, long=long)
    log = read_log(file)
    np.testing.assert_allclose(log.time, np.arange(n) / 100.0)
    np.testing.assert_allclose(log.tracker_cp.position, path, atol=1e-6)
    if long or n < 65536:
        whole = file.read_bytes()
        with pytest.raises(LogError, match="cut off"):
            read_log(write(tmp_path / "cut.c3d", whole[: len(whole) - 1024]))


def test_a_marker_at_the_very_origin_is_hidden(tmp_path: Path):
    """Some programs write 0, 0, 0 without a negative residual for what they do not see."""
    _, at, points = motion(11)
    points[3, 0] = 0.0
    log = read_log(write_c3d(tmp_path / "a.c3d", points * 1e3, LABELS))
    np.testing.assert_allclose(log.tracker_cp.position[3], at[3], atol=1e-6)
