from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mocap_support import (
    RATE,
    Tool,
    mapping,
    moving_tool,
    write_lines,
    write_motive,
    write_ndi,
    write_nexus,
    write_qualisys,
    write_tracker,
    write_trc,
)
from read_support import write
from scipy.spatial.transform import Rotation

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog

ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def assert_sees(log: CalibrationLog, tool: Tool, *, turned: bool = True) -> None:
    """Assert that the log holds the tool's poses where it was seen, nothing where it was hidden; six digits."""
    np.testing.assert_array_equal(np.isnan(log.tracker_cp.position).any(axis=1), tool.hidden)
    seen = ~tool.hidden
    np.testing.assert_allclose(log.tracker_cp.position[seen], tool.position[seen], atol=2e-6)
    if turned:
        found = Rotation.from_quat(log.tracker_cp.quaternion[seen], scalar_first=True)
        assert (found * tool.rotation[seen].inv()).magnitude().max() < 1e-5
        assert np.isnan(log.tracker_cp.quaternion[tool.hidden]).all()


def assert_turns_alike(log: CalibrationLog, tool: Tool) -> None:
    """Assert the tool's pose up to the axes and the origin that the markers define."""
    seen = ~tool.hidden
    centre = tool.markers.mean(axis=1)
    np.testing.assert_array_equal(np.isnan(log.tracker_cp.position).any(axis=1), tool.hidden)
    np.testing.assert_allclose(log.tracker_cp.position[seen], centre[seen], atol=2e-6)
    found = Rotation.from_quat(log.tracker_cp.quaternion[seen], scalar_first=True)
    assert (found * (tool.rotation[seen] * tool.rotation[seen][0].inv()).inv()).magnitude().max() < 1e-4


@pytest.mark.parametrize("version", ["1.2", "1.21", "1.23", "1.24", "1.25"])
def test_every_version_of_motives_header_gives_the_same_recording(tmp_path: Path, version: str):
    """Labels of the header lines, a time code and parents come and go; the poses do not."""
    tool = moving_tool(0)
    log = read_log(write_motive(tmp_path / "take.csv", tool, version=version, labelled=version not in ("1.2", "1.21")))
    assert_sees(log, tool)
    np.testing.assert_allclose(log.time, tool.time, atol=1e-6)
    assert log.remarks == ("tracker_cp is the body tool.",)
    assert log.meta.tracker == "OptiTrack Motive"
    np.testing.assert_allclose(log.extra["marker_rms"][~tool.hidden], 1e-4)


def test_a_unit_that_the_header_has_wrong_is_mended_by_a_scale_alone(tmp_path: Path):
    """As `gpcorrect validate` says: millimetres under the title of metres, and the markers' error with them."""
    tool = moving_tool(2)
    path = write_motive(tmp_path / "take.csv", tool, unit="Meters", scale=1e3)
    log = read_log(path, columns=write(tmp_path / "m.toml", "[tracker_cp]\nposition_scale = 1e-3\n"))
    assert_sees(log, tool)
    np.testing.assert_allclose(log.extra["marker_rms"][~tool.hidden], 1e-4)


@pytest.mark.parametrize("order", ORDERS)
def test_motives_euler_angles_are_read_in_the_order_that_the_header_names(tmp_path: Path, order: str):
    """All six orders give the same rotations."""
    tool = moving_tool(1)
    assert_sees(read_log(write_motive(tmp_path / "take.csv", tool, rotation=order)), tool)


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1.0), ("Centimeters", 1e2), ("Millimeters", 1e3)])
def test_motives_unit_is_turned_into_metres(tmp_path: Path, unit: str, scale: float):
    """The header's unit holds for positions and for the error of the markers."""
    tool = moving_tool(2)
    log = read_log(write_motive(tmp_path / "take.csv", tool, unit=unit, scale=scale))
    assert_sees(log, tool)
    np.testing.assert_allclose(log.extra["marker_rms"][~tool.hidden], 1e-4)


def test_one_of_several_bodies_must_be_named(tmp_path: Path):
    """Nobody guesses which body is the tool."""
    tool = moving_tool(3)
    path = write_motive(tmp_path / "take.csv", tool, names=("tool", "base"))
    with pytest.raises(LogError, match=r'2 bodies: tool, base.*\[mocap\] body = "tool"'):
        read_log(path)
    assert_sees(read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "tool"})), tool)
    with pytest.raises(LogError, match=r"there is no body Tool.*Bodies here: tool, base"):
        read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "Tool"}))


def test_labelled_markers_make_the_tool_where_no_body_was_solved(tmp_path: Path):
    """Unlabelled markers are not on the tool; markers that were seen come before those that were expected."""
    tool = moving_tool(4)
    bare = read_log(write_motive(tmp_path / "bare.csv", tool, bodies=False))
    assert_turns_alike(bare, tool)
    assert "Unlabeled" not in bare.remarks[0]
    chosen = mapping(tmp_path / "m.toml", {"markers": tuple(f"tool:Marker {k:03d}" for k in range(1, 6))})
    assert_turns_alike(read_log(write_motive(tmp_path / "both.csv", tool), columns=chosen), tool)


@pytest.mark.parametrize("kind", ["", "Helical", "Euler", "Quaternion"])
@pytest.mark.parametrize("lost", ["0", ""])
def test_trackers_objects_are_read_whatever_the_angles(tmp_path: Path, kind: str, lost: str):
    """Rotation vectors, Euler angles and quaternions; a lost object is zeros or empty cells."""
    tool = moving_tool(5)
    log = read_log(write_tracker(tmp_path / "trial.csv", tool, kind=kind, lost=lost))
    assert_sees(log, tool)
    np.testing.assert_allclose(np.diff(log.time), 0.01)
    assert any("rotation vectors" in r for r in log.remarks) == (kind == "")


def test_the_user_may_say_that_angles_are_euler_angles(tmp_path: Path):
    """What the header leaves open the mapping file settles, and no remark is left."""
    tool = moving_tool(6)
    path = write_tracker(tmp_path / "trial.csv", tool, kind="Euler", unit="deg")
    path.write_text(path.read_text().replace(" (Euler)", ""))
    log = read_log(path, columns=mapping(tmp_path / "m.toml", {"rotation": "XYZ"}))
    assert_sees(log, tool)
    assert log.remarks == ("tracker_cp is the body tool.",)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_trajectories_of_nexus_are_found_among_its_sections(tmp_path: Path, delimiter: str):
    """Devices at another rate come before them; unlabelled trajectories are left out; frames begin anywhere."""
    tool = moving_tool(7)
    log = read_log(write_nexus(tmp_path / "trial.csv", tool, delimiter=delimiter))
    assert_turns_alike(log, tool)
    assert log.time[0] == pytest.approx(1.01)
    assert log.remarks == ("tracker_cp was computed from the markers tool:M0, tool:M1, tool:M2, tool:M3, tool:M4.",)


def test_a_solved_segment_comes_before_markers_and_markers_when_they_are_asked_for(tmp_path: Path):
    """One file may hold both."""
    tool = moving_tool(8)
    path = write_nexus(tmp_path / "trial.csv", tool, segments=True)
    assert_sees(read_log(path), tool)
    chosen = mapping(tmp_path / "m.toml", {"markers": tuple(f"tool:M{k}" for k in range(5))})
    assert_turns_alike(read_log(path, columns=chosen), tool)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e3), ("m", 1.0)])
@pytest.mark.parametrize("gap", ["", "nan", "0"])
@pytest.mark.parametrize("blank", [True, False])
def test_trc_files_of_every_writer_give_the_same_markers(
    tmp_path: Path, unit: str, scale: float, gap: str, blank: bool
):
    """Hidden markers are empty, nan or zeros; the empty line below the header may be missing."""
    tool = moving_tool(9)
    log = read_log(write_trc(tmp_path / "trial.trc", tool, unit=unit, scale=scale, gap=gap, blank=blank))
    assert_turns_alike(log, tool)
    np.testing.assert_allclose(np.diff(log.time), 1 / RATE, atol=2e-6)
    assert any("exactly 0, 0, 0" in r for r in log.remarks) == (gap == "0")


def test_decimal_commas_inside_cells_are_numbers(tmp_path: Path):
    """A German Nexus writes semicolons and commas."""
    tool = moving_tool(10)
    path = write_nexus(tmp_path / "trial.csv", tool, delimiter=";")
    path.write_text(path.read_text().replace(".", ","))
    assert_turns_alike(read_log(path), tool)


@pytest.mark.parametrize("writer", [write_motive, write_tracker, write_nexus, write_trc, write_qualisys, write_ndi])
def test_a_byte_order_mark_changes_nothing(tmp_path: Path, writer):
    """Windows puts one before the first word."""
    path = writer(tmp_path / "a.txt", moving_tool(11))
    plain = read_log(path).tracker_cp.position
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    np.testing.assert_array_equal(read_log(path).tracker_cp.position, plain)


@pytest.mark.parametrize("writer", [write_motive, write_tracker, write_nexus, write_trc, write_qualisys, write_ndi])
def test_a_file_cut_off_inside_a_line_is_refused(tmp_path: Path, writer):
    """Half a number is another number: never read."""
    whole = writer(tmp_path / "a.txt", moving_tool(12)).read_bytes().rstrip()
    last = whole.rindex(b"\n")
    for size in range(last + 4, len(whole) - 20, 25):
        with pytest.raises(LogError, match="cut off"):
            read_log(write(tmp_path / "cut.txt", whole[:size]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("Length Units,Meters", "Length Units,Furlongs"), "Furlongs"),
        (("Rotation Type,Quaternion", "Rotation Type,Gibbs"), "Gibbs"),
        (("Length Units,Meters,", ""), "Length Units"),
        (("Time (Seconds)", "Clock"), "Time"),
        (("0.000000", "x0.00"), "x0.00"),
    ],
)
def test_what_is_wrong_with_motives_header_is_named(tmp_path: Path, change: tuple[str, str], said: str):
    """Unknown units and rotations are refused, not guessed."""
    path = write_motive(tmp_path / "take.csv", moving_tool(15))
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(LogError, match=said):
        read_log(path)


def test_what_is_wrong_with_the_other_headers_is_named(tmp_path: Path):
    """The line and what was expected there are in the message."""
    tool = moving_tool(16)
    trc = write_trc(tmp_path / "a.trc", tool).read_text()
    for old, new, said in (
        ("\tmm\t", "\tyards\t", "yards"),
        ("tool:M1", "tool:M0", "4 different"),
        ("Frame#", "Frames", "line 4"),
    ):
        with pytest.raises(LogError, match=said):
            read_log(write(tmp_path / "b.trc", trc.replace(old, new)))
    vicon = write_tracker(tmp_path / "a.csv", tool).read_text()
    for old, new, said in (
        ("Objects\n100\n", "Objects\nfast\n", "rate in Hz in line 2"),
        ("Objects", "Events", "expected a section Objects"),
        ("mm", "px", "px"),
    ):
        with pytest.raises(LogError, match=said):
            read_log(write(tmp_path / "b.csv", vicon.replace(old, new)))


def test_the_header_counts_other_frames(tmp_path: Path):
    """A trial cut out of a longer one is read, and said."""
    path = write_trc(tmp_path / "a.trc", moving_tool(17))
    path.write_text(path.read_text().replace("\t60\t5\t", "\t999\t5\t"))
    assert any("999 frames, the file holds 60" in r for r in read_log(path).remarks)


def test_a_body_and_markers_cannot_both_be_the_tool(tmp_path: Path):
    """The mapping file says one thing."""
    path = write_motive(tmp_path / "take.csv", moving_tool(18))
    with pytest.raises(LogError, match="not both"):
        read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "tool", "markers": ("a",)}))


@pytest.mark.parametrize("above", [1, 0])
def test_a_vicon_export_without_its_title_is_known_by_its_axes(tmp_path: Path, above: int):
    """The rate is the line above the names; where it is missing too, the mapping file says it."""
    tool = moving_tool(19)
    path = write_nexus(tmp_path / "trial.csv", tool, above=above)
    rate = write_lines(tmp_path / "m.toml", ["rate = 100.0"])
    log = read_log(path, columns=None if above else rate)
    assert_turns_alike(log, tool)
    np.testing.assert_allclose(np.diff(log.time), 0.01)
    if not above:
        with pytest.raises(LogError, match=r"expected the rate in Hz.*rate = 100\.0"):
            read_log(path)


@pytest.mark.parametrize("virtual", ["named", "unnamed"])
def test_virtual_markers_of_a_trc_file_are_not_on_the_tool(tmp_path: Path, virtual: str):
    """Neither those that line 4 calls V_ nor columns without a name change the pose; named, they are read."""
    tool = moving_tool(20)
    path = write_trc(tmp_path / "a.trc", tool, virtual=virtual)
    log = read_log(path)
    assert_turns_alike(log, tool)
    name = "V_mid" if virtual == "named" else "V_unnamed_6"
    assert f"virtual markers are left out unless named: {name}." in log.remarks
    alone = read_log(path, columns=mapping(tmp_path / "m.toml", {"markers": (name,)}))
    np.testing.assert_allclose(alone.tracker_cp.position, tool.markers[:, :2].mean(axis=1) + 0.007, atol=2e-6)


@pytest.mark.parametrize("titled", [True, False])
@pytest.mark.parametrize("kind", ["3D", "6D"])
def test_qualisys_bodies_and_markers_are_read(tmp_path: Path, kind: str, titled: bool):
    """With or without the line of column names; the matrix stands column by column, the residual is the error."""
    tool = moving_tool(21)
    log = read_log(write_qualisys(tmp_path / "a.tsv", tool, kind=kind, titled=titled))
    (assert_sees if kind == "6D" else assert_turns_alike)(log, tool)
    np.testing.assert_allclose(log.time, tool.time, atol=1e-6)
    if kind == "6D":
        np.testing.assert_allclose(log.extra["marker_rms"][~tool.hidden], 1e-4)


def test_one_of_qualisys_bodies_is_chosen(tmp_path: Path):
    """The same choice as with the other systems."""
    path = write_qualisys(tmp_path / "a.tsv", moving_tool(22), names=("tool", "base"), lost="NULL")
    with pytest.raises(LogError, match="2 bodies: tool, base"):
        read_log(path)
    assert_sees(read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "base"})), moving_tool(22))


@pytest.mark.parametrize("form", ["track", "toolbox", "capi"])
def test_ndi_tools_are_read(tmp_path: Path, form: str):
    """Tools are named without port and serial number; a tool that was not seen is missing; frames count at 60 Hz."""
    tool = moving_tool(23, rate=RATE if form == "track" else 60.0)
    log = read_log(write_ndi(tmp_path / "a.csv", tool, form=form))
    assert_sees(log, tool)
    assert log.remarks[0] == "tracker_cp is the body tool."
    assert any("60 Hz" in r for r in log.remarks) == (form != "track")
    np.testing.assert_allclose(log.time - log.time[0], tool.time, atol=1e-6 if form == "track" else 0.5 / 60)
    np.testing.assert_allclose(log.extra["marker_rms"][~tool.hidden], 2.5e-4)


def test_one_of_ndis_tools_is_chosen(tmp_path: Path):
    """Groups of columns are told apart however many markers each tool has."""
    tool = moving_tool(24, rate=60.0)
    for form in ("track", "toolbox", "capi"):
        path = write_ndi(tmp_path / f"{form}.csv", tool, form=form, names=("tool", "base"))
        log = read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "base"}))
        np.testing.assert_allclose(log.tracker_cp.position[~tool.hidden], tool.position[~tool.hidden] + 1, atol=2e-6)
    with pytest.raises(LogError, match="Export rotations as quaternions"):
        read_log(
            write_lines(
                tmp_path / "b.csv", ["Tools,Port 1,Frame,Face,State,Rz,Ry,Rx,Tx,Ty,Tz,Error", "1,Port 1,1,1,OK"]
            )
        )


def test_tools_that_change_places_from_line_to_line_are_not_mixed(tmp_path: Path):
    """Poses of the second tool were taken for the first one's."""
    lines = write_ndi(tmp_path / "a.csv", moving_tool(25)).read_text().splitlines()
    half = [line.replace(": tool ", ": base ") if k > len(lines) // 2 else line for k, line in enumerate(lines)]
    with pytest.raises(LogError, match=r"holds the tools .*base.*, line 2 .*tool"):
        read_log(write_lines(tmp_path / "b.csv", half))


def test_items_of_one_name_are_refused(tmp_path: Path):
    """The last one won, in silence."""
    for path in (write_tracker(tmp_path / "t.csv", moving_tool(26)), write_motive(tmp_path / "m.csv", moving_tool(26))):
        rows = [line.split(",") for line in path.read_text().splitlines()]
        top = next(k for k, row in enumerate(rows) if row[0] == "Frame")
        twice = [row + row[2:] if k <= top + 1 or row[0].isdigit() else row for k, row in enumerate(rows)]
        with pytest.raises(LogError, match="are called"):
            read_log(write_lines(path, [",".join(row) for row in twice]))


@pytest.mark.parametrize("rate", ["0", "-100", "nan", "inf"])
def test_a_rate_that_is_none_is_refused(tmp_path: Path, rate: str):
    """It made stamps of infinity, of no number, or backwards."""
    path = write_tracker(tmp_path / "t.csv", moving_tool(27))
    lines = path.read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("Frame")) - 2
    lines[at] = rate
    with pytest.raises(LogError, match="expected the rate in Hz"):
        read_log(write_lines(path, lines))


def test_disordered_time_of_an_export_is_refused_or_left_out(tmp_path: Path):
    """As in any other format."""
    path = write_qualisys(tmp_path / "q.tsv", moving_tool(28))
    lines = path.read_text().splitlines()
    lines[-2], lines[-3] = lines[-3], lines[-2]
    path = write_lines(path, lines)
    with pytest.raises(LogError, match="out of order"):
        read_log(path)
    log = read_log(path, disorder="drop")
    assert (np.diff(log.time) > 0).all()
    assert any("left out" in remark for remark in log.remarks)


@pytest.mark.parametrize("empty", ["", ",,,"])
@pytest.mark.parametrize("writer", [write_motive, write_tracker, write_nexus, write_trc, write_qualisys, write_ndi])
def test_no_sample_behind_an_empty_line_is_lost(tmp_path: Path, writer, empty: str):
    """All that followed was left out, without a word."""
    path = writer(tmp_path / "a.csv", moving_tool(29))
    whole = read_log(path)
    mark = "\t" if writer in (write_qualisys, write_trc) else ","
    lines = path.read_text().splitlines()
    at = len(lines) - 10
    log = read_log(write_lines(path, [*lines[:at], empty.replace(",", mark), *lines[at:]]))
    np.testing.assert_array_equal(log.time, whole.time)
    np.testing.assert_array_equal(log.tracker_cp.table, whole.tracker_cp.table)


def test_a_frame_that_shows_nothing_is_a_frame(tmp_path: Path):
    """Qualisys may write neither frame nor time, and nothing in place of what it does not see: a line of tabs."""
    tool = moving_tool(30)
    assert_sees(read_log(write_qualisys(tmp_path / "q.tsv", tool, titled=False, lost="")), tool)
