import asyncio
import json

import numpy as np
import pytest
from msgspec.structs import replace

from gpcorrect_service.crtk.messages import Heartbeat, OperatingState, Pose, Report, Text
from gpcorrect_service.monitor.app import application
from gpcorrect_service.monitor.board import Board, BoardSettings
from gpcorrect_service.monitor.drift import DriftWatch, outside
from gpcorrect_service.protocol.messages import HealthAnswer

GONE = BoardSettings().gone

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def report(stamp: float = 10.0, *, inside: bool = True, model: str = "m", width: float | None = 0.003) -> Report:
    return Report(
        stamp=stamp,
        desired=(0.1, 0.0, 0.0, *UPRIGHT),
        command=(0.104, 0.003, 0.0, *UPRIGHT),
        std=(0.0015,) * 6,
        interval95=(width, 0.002, 0.002, 0.1, 0.1, 0.1),
        in_domain=inside,
        status="OK" if inside else "EXTRAPOLATING",
        reason="",
        seconds=0.0005,
        model_id=model,
        model_hash=model * 64,
        reference=(0.1, 0.0, 0.0, *UPRIGHT),
    )


def tracked(stamp: float = 10.0, x: float = 0.1) -> Pose:
    return Pose(stamp, (x, 0.0, 0.0, *UPRIGHT), "tracker")


def health(replica: str = "r1", model: str = "h") -> HealthAnswer:
    counts = {"correct": {"OK": 8, "EXTRAPOLATING": 2, "BUSY": 1}, "model": {"OK": 5}}
    return HealthAnswer("ENABLED", "arm1", replica, "m", model * 64, 60.0, {"correct": 1}, counts)


def arm(board: Board, now: float = 100.0) -> dict:
    """Return the only arm of a snapshot that went through JSON."""
    (only,) = json.loads(json.dumps(board.snapshot(now), allow_nan=False))["arms"]
    return only


def test_a_snapshot_shows_what_was_received():
    """Correction, miss, interval, latency, state and poses are the messages' own numbers in mm and ms."""
    board = Board("ns")
    board.received("arm1", "operating_state", OperatingState(10.0, "ENABLED", True, False), 99.0)
    board.received("arm1", "heartbeat", Heartbeat(10.0, 500.0, 0), 99.0)
    for stamp in (10.0, 10.02):
        board.received("arm1", "corrected/report", report(stamp), 99.0)
    board.received("arm1", "tracker_cp", tracked(10.01, 0.102), 99.5)
    shown = arm(board)
    assert shown["operating_state"] == "ENABLED"
    assert shown["rate_hz"] == 500.0
    assert shown["silent_seconds"] == pytest.approx(0.5)
    assert shown["correction"]["mm"] == pytest.approx(5.0)
    assert shown["correction"]["interval_mm"] == pytest.approx([3.0, 2.0, 2.0])
    assert shown["error"]["mm"] == pytest.approx(2.0)
    assert shown["latency_ms"]["median"] == pytest.approx(0.5)
    assert shown["poses"]["desired"]["mm"] == pytest.approx([100.0, 0.0, 0.0])
    assert shown["poses"]["measured"] is None


def test_what_was_not_learned_is_not_shown_as_a_number():
    """A width that does not exist is null in the page's JSON, which has no NaN."""
    board = Board("ns")
    board.received("arm1", "corrected/report", report(width=None), 99.0)
    assert arm(board)["correction"]["interval_mm"][0] is None


def test_poses_of_different_moments_are_not_compared():
    """A tracked pose of no report's moment says nothing of the correction; the page says why there is none."""
    for stamps, off, why in (
        ((10.0, 10.02), -5.0, "5.00 s behind"),
        ((10.0, 10.02), 3.0, "3.00 s ahead"),
        ((10.0, 10.5), -0.25, "more than 0.15 s apart"),
    ):
        board = Board("ns")
        for stamp in stamps:
            board.received("arm1", "corrected/report", report(stamp), 99.5)
        board.received("arm1", "tracker_cp", tracked(stamps[-1] + off), 99.5)
        shown = arm(board)
        assert shown["error"] is None
        assert shown["drift"]["idle_seconds"] is None
        assert why in shown["drift"]["why"]


def moving(late: float, *, jump: float = 0.0, seconds: float = 20.0, behind: float = 0.0, speed: float = 0.2) -> Board:
    """Return a board that saw a tool go to and fro, tracked at 50 Hz, `late` s later, by a clock that is `behind`."""
    board, seen = Board("ns"), []
    for k in range(int(100 * seconds)):
        t = 0.01 * k
        x = 0.1 + speed / 3.0 * np.sin(3.0 * t)
        board.received("arm1", "corrected/report", replace(report(1000.0 + t), desired=(x, 0.0, 0.0, *UPRIGHT)), t)
        if k % 2:
            seen.append((t + late, tracked(1000.0 + t - behind, x + jump)))
        while seen and seen[0][0] <= t:
            board.received("arm1", "tracker_cp", seen.pop(0)[1], t)
    return board


@pytest.mark.parametrize("late", [0.0, 0.025, 0.05, 0.2, 0.9])
def test_a_late_tracker_is_compared_with_the_reports_of_its_moment(late):
    """Stamped honestly, a pose may come late: the miss of a fast healthy tool is nought, and a jump is an alarm."""
    healthy, jumped = arm(moving(late), 20.0), arm(moving(late, jump=0.0075), 20.0)
    assert healthy["error"]["mm"] < 0.05
    assert not healthy["drift"]["alarm"]
    assert healthy["drift"]["votes"] > 15
    assert jumped["error"]["mm"] == pytest.approx(7.5, abs=0.05)
    assert jumped["drift"]["alarm"]


def test_a_tracker_whose_clock_is_off_errs_by_the_way_of_that_time():
    """Nothing can tell a clock that is 80 ms behind from an arm that leads: the miss is speed times 80 ms."""
    slow, fast = (arm(moving(0.0, behind=0.08, speed=speed, seconds=21 * np.pi / 3), 22.0) for speed in (0.02, 0.2))
    assert slow["error"]["mm"] == pytest.approx(1.6, rel=0.05)
    assert fast["error"]["mm"] == pytest.approx(16.0, rel=0.05)


def test_poses_tracked_before_their_report_wait_for_it():
    """A pose that is later than the newest report is compared when the next one comes."""
    board = Board("ns")
    board.received("arm1", "corrected/report", report(10.0), 99.0)
    board.received("arm1", "tracker_cp", tracked(10.01, 0.102), 99.0)
    assert arm(board)["error"] is None
    board.received("arm1", "corrected/report", report(10.02), 99.0)
    assert arm(board)["error"]["mm"] == pytest.approx(2.0)


def test_evidence_of_long_ago_says_so():
    """Where the tracker fell silent, or the model does not know the poses, nothing is compared, and it says so."""
    board = moving(0.0)
    assert arm(board, 20.0)["drift"]["why"] == ""
    dead = arm(board, 27.0)
    assert dead["drift"]["idle_seconds"] == pytest.approx(7.0, abs=0.1)
    assert dead["drift"]["why"]
    assert dead["error"]["age"]["old"]
    for k in range(500):
        board.received("arm1", "corrected/report", report(1030.0 + 0.01 * k, inside=False), 30.0 + 0.01 * k)
        board.received("arm1", "tracker_cp", tracked(1030.0 + 0.01 * k), 30.0 + 0.01 * k)
    outside = arm(board, 35.0)
    assert not outside["error"]["age"]["old"]
    assert "does not know" in outside["drift"]["why"]


def test_what_comes_by_two_ways_counts_once():
    """A server that is connected to the robot hands its messages on; where one way is silent the other counts."""
    board = Board("ns")
    for now, way in ((99.0, "robot"), (99.001, "server"), (103.0, "server"), (103.001, "robot")):
        board.received("arm1", "error", Text(now, "not homed"), now, way)
    assert arm(board)["refused"] == 2


def test_the_fraction_out_of_domain_is_that_of_the_last_minute():
    """Reports older than a minute no longer count."""
    board = Board("ns")
    for k in range(10):
        board.received("arm1", "corrected/report", report(1.0 + k, inside=False), 10.0 + k)
    for k in range(6):
        board.received("arm1", "corrected/report", report(90.0 + k, inside=k < 3), 90.0 + k)
    assert arm(board)["outside_share"] == pytest.approx(0.5)


def test_two_arms_and_their_replicas_stay_apart():
    """Each arm has its own state and servers; a server that fell silent is shown as gone, and later not at all."""
    board = Board("ns")
    board.received("arm2", "error", Text(1.0, "not homed"), 99.0)
    board.replica("arm1", health("r1"), 0.002, 99.0)
    board.replica("arm1", health("r2"), 0.004, 99.0 + GONE)
    first, second = board.snapshot(99.5 + GONE)["arms"]
    assert (first["name"], second["name"]) == ("arm1", "arm2")
    assert [r["state"] for r in first["replicas"]] == ["GONE", "ENABLED"]
    assert first["replicas"][1]["round_trip_ms"] == pytest.approx(4.0)
    assert (first["replicas"][0]["asked"], first["replicas"][0]["faults"]) == (11, 1)
    assert first["replicas"][0]["outside_share"] == pytest.approx(2 / 11)
    assert (second["refused"], second["last_refusal"]) == (1, "not homed")
    assert board.snapshot(1000.0)["arms"][0]["replicas"] == []


UNREADABLE = [
    ("tracker_cp", Pose(10.0, (0.1, 0.0, 0.0))),
    ("tracker_cp", Pose(10.0, (float("nan"), 0.0, 0.0, *UPRIGHT))),
    ("measured_cp", Pose(10.0, (0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))),
    ("servo_cp", Pose(float("inf"), (0.1, 0.0, 0.0, *UPRIGHT))),
    ("heartbeat", Heartbeat(10.0, float("nan"), 0)),
    ("corrected/report", replace(report(), interval95=(0.1,))),
    ("corrected/report", replace(report(), seconds=float("nan"))),
    ("corrected/report", replace(report(), reference=(1.0,))),
    ("error", Text(1.0, "x" * 100_000)),
]


@pytest.mark.parametrize(("name", "message"), UNREADABLE)
def test_one_message_that_means_nothing_hides_no_arm(name, message):
    """A malformed message is counted at its arm; every arm is shown as before, in JSON without NaN."""
    board = Board("ns")
    for one in ("arm1", "arm2"):
        board.received(one, "corrected/report", report(), 99.0)
        board.received(one, "tracker_cp", tracked(), 99.0)
    before = board.snapshot(99.5)["arms"]
    board.received("arm1", name, message, 99.2)
    first, second = json.loads(json.dumps(board.snapshot(99.5), allow_nan=False))["arms"]
    assert (first["unreadable"], second["unreadable"]) == (1, 0)
    assert name in first["last_unreadable"]
    assert {**first, "unreadable": 0, "last_unreadable": ""} == before[0]
    assert second == before[1]


def test_a_server_that_says_nan_is_shown():
    """A number that does not exist in a server's health is null in the page's JSON."""
    board = Board("ns")
    board.replica("arm1", replace(health(), uptime=float("nan")), float("inf"), 99.0)
    assert arm(board)["replicas"][0]["uptime"] is None


def test_strangers_do_not_fill_the_page():
    """Names of arms beyond a bound are not taken up; those that are known go on."""
    board = Board("ns")
    for k in range(500):
        board.received(f"arm{k}", "error", Text(1.0, "no"), 99.0)
    board.received("arm0", "error", Text(1.0, "again"), 99.0)
    arms = board.snapshot(99.0)["arms"]
    assert len(arms) == BoardSettings().arms
    assert arms[0]["refused"] == 2


def test_what_was_said_long_ago_says_so():
    """Status, correction, poses and state carry their ages, and are old when nothing has come for a while."""
    board = Board("ns")
    board.received("arm1", "operating_state", OperatingState(10.0, "ENABLED", True, False), 99.0)
    board.received("arm1", "corrected/report", report(), 99.0)
    fresh, later = arm(board, 99.5), arm(board, 289.0)
    for shown, seconds, old in ((fresh, 0.5, False), (later, 190.0, True)):
        for age in (shown["correction"]["age"], shown["state_age"], shown["poses"]["desired"]["age"]):
            assert age == {"seconds": pytest.approx(seconds), "old": old}
    assert fresh["outside_share"] == 0.0
    assert later["outside_share"] is None


def test_servers_with_different_models_are_said_to_differ():
    """Two models behind one arm are a warning while both servers live, and none when one is gone."""
    board = Board("ns")
    board.replica("arm1", health("r1", "a"), 0.002, 99.0)
    board.replica("arm1", health("r2", "a"), 0.002, 99.0)
    assert not arm(board)["models_differ"]
    board.replica("arm1", health("r2", "b"), 0.002, 99.0 + GONE)
    assert arm(board, 99.0)["models_differ"]
    assert not arm(board, 99.5 + GONE)["models_differ"]


def test_the_joint_interval_holds_at_95_in_a_hundred():
    """Gaussian misses of the size that their intervals say are outside five times in a hundred, whatever is known."""
    rng = np.random.default_rng(0)
    std = np.array([1e-3, 2e-3, 1e-3, 0.1, 0.2, 0.1])
    for known in (3, 6):
        width = [1.96 * s if i < known else None for i, s in enumerate(std)]
        share = np.mean([outside((std * rng.standard_normal(6)).tolist(), width) for _ in range(4000)])
        assert 0.04 < share < 0.06
    assert not outside([1.0] * 6, [None] * 6)


def test_a_model_that_holds_raises_no_alarm_and_one_that_does_not_does():
    """With every twentieth second outside there is no alarm in an hour; when the arm changes it comes in seconds."""
    rng = np.random.default_rng(1)
    watch, stamp = DriftWatch(), 0.0
    for _ in range(3600):
        out = rng.random() < 0.05
        for _ in range(10):
            stamp += 0.1
            watch.see(stamp, out)
    assert not watch.alarm
    begin = stamp
    while not watch.alarm:
        stamp += 0.1
        watch.see(stamp, rng.random() < 0.9)
        assert stamp < begin + 30.0
    assert stamp - begin > 3.0


def test_another_model_starts_with_a_clean_slate():
    """Evidence against one model does not count against the next."""
    board = Board("ns")
    for k in range(2000):
        stamp = 10.0 + 0.02 * k
        board.received("arm1", "corrected/report", report(stamp), stamp)
        board.received("arm1", "tracker_cp", tracked(stamp, 0.12), stamp)
    assert arm(board)["drift"]["alarm"]
    board.received("arm1", "corrected/report", report(100.0, model="n"), 100.0)
    assert not arm(board)["drift"]["alarm"]


def ask(path: str, method: str = "GET", host: str = "127.0.0.1") -> tuple[int, dict[str, str], str]:
    """Return status, headers and body of one request to the page's server."""
    sent: list[dict] = []

    async def receive() -> dict:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: dict) -> None:
        sent.append(message)

    scope = {
        "type": "http",
        "http_version": "1.1",
        "method": method,
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "headers": [(b"host", host.encode())],
        "scheme": "http",
        "server": (host, 80),
    }
    asyncio.run(application(Board("ns"), ["127.0.0.1"])(scope, receive, send))
    headers = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
    return sent[0]["status"], headers, b"".join(m.get("body", b"") for m in sent[1:]).decode()


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_can_be_sent_to_the_page(method):
    """Every path answers GET alone."""
    for path in ("/", "/page.js", "/page.css", "/api/state", "/events"):
        assert ask(path, method)[0] == 405


def test_the_page_comes_from_here_alone():
    """Page, style and script are served with headers that let nothing else in, and to this machine's name only."""
    for path, kind in (("/", "text/html"), ("/page.css", "text/css"), ("/page.js", "text/javascript")):
        status, headers, body = ask(path)
        assert status == 200
        assert headers["content-type"].startswith(kind)
        assert "default-src 'self'" in headers["content-security-policy"]
        assert "://" not in body
    assert json.loads(ask("/api/state")[2]) == {"namespace": "ns", "arms": []}
    assert ask("/", host="evil.example")[0] == 400
