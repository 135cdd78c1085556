"""`gpcorrect vision`: calibrate cameras, and track coloured balls with them into a log."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpcorrect.atomic import require_new, require_own, write_file
from gpcorrect.cli import console
from gpcorrect.cli import options as opt
from gpcorrect.cli.processes import stop_signal
from gpcorrect.cli.reading import read_logs
from gpcorrect.errors import DataError

if TYPE_CHECKING:  # OpenCV is an extra, and scikit-learn is slow: they are imported when a command needs them
    from gpcorrect.vision import Frame, LiveView, Target
    from gpcorrect.vision.opencv import Image

STATE = ("measured_cp", "tracker_cp", "measured_jp")  # what an estimator learns from
vision_app = typer.Typer(no_args_is_help=True)


BoardColumns = Annotated[int, typer.Option(help="Inner corners along the board's long side.")]
BoardRows = Annotated[int, typer.Option(help="Inner corners along its short side.")]
Square = Annotated[float, typer.Option(help="Side of a square, mm, as measured on the print.")]


@dataclass(frozen=True)
class LivePlace(opt.RobotPlace):
    """Whether pictures are shown while the command works, and where; its fields become options."""

    live: Annotated[
        bool, typer.Option("--live", help="Show the pictures on `gpcorrect monitor` meanwhile, as those of --arm.")
    ] = False


@vision_app.command()
def board(
    output: Annotated[Path, typer.Option("--output", "-o", help="PDF to write.")] = Path("board.pdf"),
    columns: BoardColumns = 9,
    rows: BoardRows = 6,
    square: Square = 20.0,
    paper: Annotated[str, typer.Option(help="a4, a3 or letter.")] = "a4",
    json: opt.Json = False,
) -> None:
    """Write the chessboard for the calibration as a PDF: print it at 100 % and glue it onto something flat.

    Example: gpcorrect vision board --square 20 --output board.pdf
    """
    from gpcorrect.plots import write_board

    require_own(output, b"%PDF", "PDF")
    write_board(output, columns, rows, 1e-3 * square, paper)
    facts = {"output": str(output), "columns": columns, "rows": rows, "square_mm": square, "paper": paper}
    console.print_result(
        facts, f"board: {output} ({paper}; print at 100 % and measure the line of 100 mm)", as_json=json
    )


@vision_app.command()
def rig(
    folders: Annotated[list[Path], typer.Argument(help="One folder a camera: pictures of the board.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Rig file to write (TOML).")] = Path("rig.toml"),
    columns: BoardColumns = 9,
    rows: BoardRows = 6,
    square: Square = 20.0,
    json: opt.Json = False,
) -> None:
    """Write the rig file for `calibrate` from pictures of the printed board.

    The tracker frame is the board's own in the picture `place` of each folder (x along its long side): the board at
    rest, seen by all cameras.

    Example: gpcorrect vision rig front/ left/ back/ right/ --square 19.9 --output rig.toml
    """
    from gpcorrect.vision import Chessboard, read_rig, rig_text

    require_new(output)
    write_file(output, rig_text(folders, Chessboard(columns, rows, 1e-3 * square), output.parent))
    at = read_rig(output).cameras[0].board_at
    if at is not None and at.stem != "place":
        console.note(
            f"no folder has a picture place: {at.stem} of every folder is taken for one moment, the board at rest"
        )
    words = f"rig: {output}   next: gpcorrect vision calibrate {output}"
    console.print_result({"output": str(output), "cameras": [folder.name for folder in folders]}, words, as_json=json)


@vision_app.command()
def record(
    cameras: Annotated[
        list[str], typer.Argument(help="Numbers of cameras (0 1 2 3) or their devices, or video files instead.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")] = Path("recording"),
    seconds: Annotated[float, typer.Option(help="How long.", min=0.0)] = 60.0,
    fps: Annotated[float, typer.Option(help="Frames a second to ask for.", min=1.0)] = 30.0,
    *,
    place: LivePlace,
    json: opt.Json = False,
) -> None:
    """Record cameras into a folder that `track` takes: a video each, and when every picture was taken.

    Ctrl-C ends it early, and what came is kept; a recording is never overwritten.

    Example: gpcorrect vision record 0 2 4 6 --seconds 30 --output monday
    """
    stop = stop_signal()
    from gpcorrect.vision import record as record_cameras
    from gpcorrect.vision import side_by_side

    with ExitStack() as stack:
        view = _live(place, stack)

        def show(pictures: Sequence[Image]) -> None:
            if view is not None:
                view.show(lambda: side_by_side(pictures))

        frames = record_cameras(cameras, output, seconds, fps, on_pictures=show, stopped=stop.is_set)
    words = f"{frames} frames of {len(cameras)} cameras   next: gpcorrect vision track {output}"
    console.print_result({"output": str(output), "cameras": cameras, "frames": frames}, words, as_json=json)


@vision_app.command()
def calibrate(
    rig: Annotated[Path, typer.Argument(help="Rig file (TOML): pictures, chessboard, markers.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Calibration file to write (JSON).")] = Path(
        "cameras.json"
    ),
    report: opt.Report = None,
    old_page: opt.OldPage = None,
    json: opt.Json = False,
) -> None:
    """Calibrate cameras: lenses from chessboards, places from markers at known points.

    Examples
    --------
    gpcorrect vision calibrate rig.toml --output cameras.json --report calibration.html
    """
    from gpcorrect.vision import calibrate_rig, read_rig, write_cameras

    require_own(output, rb'\s*{\s*"format"', "cameras file")
    page = opt.report_page(report)
    with console.progress_bar(quiet=json) as progress:
        result = calibrate_rig(read_rig(rig), progress)
    write_cameras([camera.camera for camera in result.cameras], output)
    if page is not None:
        from gpcorrect.report import write_calibration_page  # the report's libraries are an extra

        write_calibration_page(result, page, console.digests(rig))
    figures = result.to_dict()
    if json:
        console.print_json(figures)
    else:
        _show_cameras(figures["cameras"])
        console.out.print(f"calibration: {output}" + (f"   page: {page}" if page else ""))


@vision_app.command()
def track(
    videos: Annotated[
        list[Path],
        typer.Argument(
            help="One video or folder of images a camera, in the calibration's order; or one folder of them."
        ),
    ],
    cameras: Annotated[Path, typer.Option("--cameras", "-c", help="Calibration file.")] = Path("cameras.json"),
    output: Annotated[Path, typer.Option("--output", "-o", help="Log to write: .csv or .parquet.")] = Path(
        "track.parquet"
    ),
    target: Annotated[
        Path | None,
        typer.Option(
            help="Target file (TOML): balls, colours, places; green, yellow and red on a 38 mm cross without it."
        ),
    ] = None,
    ball: Annotated[str | None, typer.Option(help="Track a single ball of this colour instead of a target.")] = None,
    fps: Annotated[float | None, typer.Option(help="Frames a second; as the videos or file names say, or 30.")] = None,
    annotated: Annotated[Path | None, typer.Option(help="Annotated video to write (.mp4 or .avi).")] = None,
    report: opt.Report = None,
    old_page: opt.OldPage = None,
    measured_only: Annotated[
        bool, typer.Option("--measured-only", help="Leave out poses that were predicted through an occlusion.")
    ] = False,
    first_look: Annotated[
        bool, typer.Option("--first-look/--no-first-look", help="Check what was given, and learn delays, first.")
    ] = True,
    workers: Annotated[int, typer.Option(help="Whole pictures searched at the same time.", min=1)] = 2,
    *,
    place: LivePlace,
    json: opt.Json = False,
) -> None:
    """Track coloured balls through synchronised videos into `tracker_cp` of a log.

    Rows whose pose was predicted through an occlusion have tracking_status 1; rows of a lost tool are empty (2).

    Examples
    --------
    gpcorrect vision track front.mp4 left.mp4 back.mp4 right.mp4 --cameras cameras.json --output log.parquet

    gpcorrect vision track monday/ --target tool.toml

    gpcorrect vision track cam0/ cam1/ --ball red --fps 25 --annotated look.mp4 --report quality.html
    """
    from gpcorrect.logs import require_writable, write_log
    from gpcorrect.logs.native import read_sidecar

    require_writable(output)  # before the libraries of the cameras, which take seconds to load
    from gpcorrect.vision import AnnotatedVideo, TrackSettings, open_sources, read_cameras
    from gpcorrect.vision import annotated as draw
    from gpcorrect.vision import track as track_sources
    from gpcorrect.vision.track import TRACKER

    if read_sidecar(output).tracker != TRACKER:  # its own it may write again
        require_new(output)
    if annotated is not None and {annotated.resolve(), annotated.resolve().parent} & {v.resolve() for v in videos}:
        hint = "Name another file or folder after --annotated."
        raise DataError(f"the annotated video {annotated} would be among the recordings that are tracked.", hint=hint)
    page = opt.report_page(report)
    followed, known = _target(target, ball), read_cameras(cameras)
    sources = open_sources(videos, [camera.name for camera in known], timed=fps is None)
    settings = TrackSettings(fps=fps, first_look=first_look, workers=workers)
    with ExitStack() as stack:
        progress = stack.enter_context(console.progress_bar(quiet=json))
        video = None
        if annotated is not None:
            rate = fps or next((source.fps for source in sources if source.fps), 30.0)
            video = stack.enter_context(AnnotatedVideo(annotated, known, followed, rate))
        view = _live(place, stack)

        def show(frame: Frame, images: Sequence[Image | None]) -> None:
            if video is not None:
                video.add(frame, images)
            if view is not None:
                view.show(lambda: draw(frame, images, known, followed))

        result = track_sources(sources, known, followed, settings, progress, show)
    write_log(result.log_without_predictions() if measured_only else result.log, output)
    if page is not None:
        from gpcorrect.report import write_tracking_page

        write_tracking_page(result, known, followed, page, console.digests(cameras, *videos))
    figures = result.to_dict()
    if json:
        console.print_json(figures)
        return
    _show_track(figures)
    console.out.print(
        " ".join(f"{name}: {path}" for name, path in (("log", output), ("video", annotated), ("page", page)) if path)
    )


@vision_app.command()
def fit(
    logs: opt.Logs,
    output: opt.ModelOutput = Path("estimator.gpc"),
    method: Annotated[str, typer.Option(help="gp, network, linear; see gpcorrect joint fit.")] = "gp",
    holdout: Annotated[float, typer.Option(help="Fraction of whole trajectories, the last ones, to measure on.")] = 0.2,
    extra: Annotated[str | None, typer.Option(help="Extra columns of the log that belong to the state.")] = None,
    columns: opt.Columns = None,
    as_is: opt.AsIs = False,
    seed: opt.Seed = 0,
    report: opt.Report = None,
    json: opt.Json = False,
) -> None:
    """Learn where the tool really is from the robot's own state, with tracker_cp as labels: no sensor needed after.

    Example: gpcorrect vision fit monday.parquet --method gp --output estimator.gpc
    """
    from gpcorrect import calibration

    calibration.require_model_place(output)
    page = opt.report_page(report)
    calibration.learner_named(method)
    # Peng et al. 2020; its batch normalisation is left out
    paper: dict[str, Any] = {"layers": (600, 500, 400), "epochs": 60}
    settings = calibration.FitSettings(method=method, extra=console.split_names(extra, "--extra"), seed=seed, **paper)
    log = read_logs(logs, columns, as_is=as_is, learned=STATE)
    experiment = console.fitted(
        log, settings, output, page, quiet=json, task=calibration.PositionEstimator, holdout=holdout
    )
    console.note(*experiment.fit.remarks, *(experiment.evaluation.cautions if experiment.evaluation else ()))
    figures = {**experiment.to_dict(), "method": method, **calibration.position_reductions(experiment.evaluation)}
    if json:
        console.print_json(figures)
        return
    _show_estimator(figures)
    console.out.print(f"trained on {experiment.fit.n_train} samples in {experiment.seconds:.1f} s -> {output}")


@vision_app.command()
def evaluate(
    model: Annotated[Path, typer.Argument(help="Model file of `gpcorrect vision fit`.")],
    logs: opt.Logs,
    columns: opt.Columns = None,
    as_is: opt.AsIs = False,
    report: opt.Report = None,
    json: opt.Json = False,
) -> None:
    """Measure a position estimator on recordings it has not seen.

    Example: gpcorrect vision evaluate estimator.gpc tuesday.parquet
    """
    from gpcorrect.calibration import PositionEstimator, evaluate_model, load, position_reductions

    page = opt.report_page(report)
    log = read_logs(logs, columns, as_is=as_is, learned=STATE)
    evaluation = evaluate_model(load(model, PositionEstimator), log)
    console.write_evaluation_page(evaluation, log, model, (), page)
    console.note(*evaluation.cautions)
    figures = {"n_test": len(evaluation.clean.rows), **evaluation.to_dict(), **position_reductions(evaluation)}
    if json:
        console.print_json(figures)
    else:
        _show_estimator(figures)


def _show_estimator(figures: dict[str, Any]) -> None:
    if "raw" not in figures:
        console.note("nothing was held out, so nothing was measured")
        return
    table = console.plain_table("position error [mm]", "RMS", "SD", "RMS x y z")
    for key, name in (("raw", "reported"), ("rigid", "after rigid motion"), ("estimated", "estimated")):
        row = figures[key]
        axes = " ".join(f"{value:.3f}" for value in row["rms_axes_mm"])
        table.add_row(name, f"{row['rms_mm']:.3f}", f"{row['sd_mm']:.3f}", axes)
    console.out.print(table)
    console.out.print(f"RMS less by {figures['rms_reduction']:.1f} %, SD by {figures['sd_reduction']:.1f} %")
    console.out.print(console.certainty(figures))


def _target(path: Path | None, ball: str | None) -> Target:
    from gpcorrect.vision import END_EFFECTOR, read_target, single_ball

    if ball is None:
        return END_EFFECTOR if path is None else read_target(path)
    if path is not None:
        raise DataError("give --target or --ball, not both.")
    return single_ball(ball)


def _live(place: LivePlace, stack: ExitStack) -> LiveView | None:
    """Open the way to the monitor, when pictures are to be shown there."""
    if not place.live:
        return None
    from gpcorrect.vision import LiveView
    from gpcorrect_service.crtk import Bus, View  # zenoh is an extra; other commands work without it

    bus = stack.enter_context(Bus(place.bus))
    return LiveView(lambda jpeg: bus.publish("view", View(time.time(), jpeg)))


def _show_cameras(cameras: list[dict[str, Any]]) -> None:
    table = console.plain_table(
        "camera", "boards", "corners [px]", "markers", "markers [px]", "focal [px]", "position ± [mm]"
    )
    for row in cameras:
        left_out = f" (without {', '.join(row['marker_outliers'])})" if row["marker_outliers"] else ""
        table.add_row(
            row["name"],
            f"{row['boards_used']}/{row['boards_given']}",
            _number(row["corner_rms_px"]),
            f"{row['markers']}{left_out}",
            _number(row["marker_rms_px"]),
            f"{row['focal_px']:.1f}",
            _number(row["position_std_mm"]),
        )
    console.out.print(table)
    for row in cameras:
        if row["without_board"]:
            console.note(f"{row['name']}: no chessboard in {', '.join(row['without_board'])}")
        if row["position_std_mm"] is None:
            console.note(f"{row['name']}: placed by its board alone, roughly: no markers were given")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _show_track(figures: dict[str, Any]) -> None:
    parts = ", ".join(f"{100 * figures[f'{name}_share']:.1f} % {name}" for name in ("measured", "coasting", "lost"))
    console.out.print(f"{figures['frames']} frames: {parts}; reprojection {_number(figures['reprojection_px'])} px")
    console.note(*figures["remarks"])
    console.out.print(f"{figures['seconds']:.1f} s, {figures['frames_a_second']:.1f} frames a second")
