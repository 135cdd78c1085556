"""`gpcorrect serve`, `prefilter` and `monitor`: processes that answer until they are stopped."""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from gpcorrect.cli import options as opt
from gpcorrect.cli.console import err
from gpcorrect.cli.processes import stop_signal
from gpcorrect.errors import DataError, MissingExtraError

FrameName = Annotated[
    str, typer.Option(help="Frame that poses come in, as they name it; the model's own name without it.")
]


def serve(
    model: Annotated[
        Path | None, typer.Argument(help="Model file that `gpcorrect fit` wrote; or the store's active one.")
    ] = None,
    joints: Annotated[Path | None, typer.Option(help="Model file that `gpcorrect joint fit` wrote.")] = None,
    store: Annotated[Path | None, typer.Option(help="Folder of models to activate from while serving.")] = None,
    endpoint: opt.Listen = opt.SERVICE,
    arm: opt.ArmName = "arm1",
    namespace: opt.KeyRoot = "gpcorrect",
    queue: Annotated[int, typer.Option(help="Requests that may wait; the next one is answered BUSY.")] = 64,
    max_rate: Annotated[float, typer.Option(help="Corrections a second; more are answered BUSY.")] = math.inf,
    max_mm: Annotated[float, typer.Option(help="Largest learned correction of position, mm.")] = math.inf,
    max_deg: Annotated[float, typer.Option(help="Largest learned correction of orientation, degrees.")] = math.inf,
    robot: Annotated[
        str, typer.Option(help="Address of the robot whose joints are estimated; without it one that connects here.")
    ] = "",
    stream_rate: Annotated[
        float, typer.Option(help="Largest change of a streamed joint correction, rad/s and m/s.")
    ] = math.inf,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse what is outside the training region.")] = False,
    frame: FrameName = "",
    metrics_port: Annotated[
        int | None,
        typer.Option(help="Port of this machine (127.0.0.1) for Prometheus to read /metrics.", min=1, max=65535),
    ] = None,
    ros_domain: opt.RosDomain = None,
    ros_distro: opt.RosName = None,
    allow_remote: opt.Remote = False,
    config: opt.Config = None,
) -> None:
    """Serve models until stopped with Ctrl-C or SIGTERM: keys correct, correct_path, correct_joints, estimate, health.

    Examples: gpcorrect serve model.gpc --arm PSM1; gpcorrect serve --store models/ --max-mm 5

    gpcorrect serve --joints joints.gpc --robot tcp/127.0.0.1:7448
    """
    stop = stop_signal()
    from gpcorrect_service import ServerSettings  # zenoh is an extra; other commands work without it
    from gpcorrect_service.protocol.bounds import CorrectionBound
    from gpcorrect_service.server.service import serve as serve_model

    distro = opt.ros_distro_of(ros_distro, ros_domain)
    settings = ServerSettings(
        endpoint=endpoint,
        arm=arm,
        namespace=namespace,
        queue_capacity=queue,
        allow_remote=allow_remote,
        config_file=config,
        bound=CorrectionBound(max_mm / 1e3, math.radians(max_deg)),
        max_rate=max_rate,
        robot=robot,
        stream_rate=stream_rate,
        strict=strict,
        frame=frame,
        metrics_port=metrics_port,
        ros_domain=ros_domain,
        ros_distro=distro,
    )
    served = ", ".join(str(path) for path in (model, joints, store) if path is not None)
    words = f"serving {served} as {namespace}/{arm}/correct on {config or endpoint}; stop with Ctrl-C"
    serve_model(model, settings, stop, lambda _: err.print(words), joint_path=joints, store=store)


def prefilter(
    model: opt.ModelFile,
    endpoint: opt.Endpoint = opt.ROBOT,
    arm: opt.ArmName = "arm1",
    namespace: opt.KeyRoot = "gpcorrect",
    linear: Annotated[float, typer.Option(help="Fastest change of the correction, mm/s.")] = 50.0,
    angular: Annotated[float, typer.Option(help="Fastest change of the correction, deg/s.")] = 60.0,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse poses out of the model's domain.")] = False,
    max_age: Annotated[float, typer.Option(help="Seconds after which a desired pose moves nothing.", min=0.01)] = 0.25,
    time_scale: Annotated[
        float, typer.Option(help="How many times faster than a real arm a simulated one lives.", min=0.01)
    ] = 1.0,
    frame: FrameName = "",
    ros_domain: opt.RosDomain = None,
    ros_distro: opt.RosName = None,
    config: opt.Config = None,
) -> None:
    """Correct a stream of desired poses before the robot sees them, until Ctrl-C or SIGTERM.

    Desired poses on NAMESPACE/ARM/servo_cp and move_cp, in the frame that the model was trained in, come out as
    commands on NAMESPACE/ARM/corrected/servo_cp and corrected/move_cp. Refused while the robot is not ENABLED and
    homed, without a stamp, and where the stamp is older than --max-age on the robot's clock; the reason is published on
    NAMESPACE/ARM/error.

    Example: gpcorrect sim serve --corrected --ready, and in another terminal gpcorrect prefilter model.gpc

    gpcorrect prefilter model.gpc --config site/prefilter.json5
    """
    stop = stop_signal()
    from gpcorrect_service.crtk import Bus, BusSettings  # zenoh is an extra; other commands work without it
    from gpcorrect_service.crtk.prefilter import FilterServer, Prefilter, PrefilterSettings
    from gpcorrect_service.ops.logger import open_logger
    from gpcorrect_service.server.models import check_arm, load_model

    distro = opt.ros_distro_of(ros_distro, ros_domain)
    settings = PrefilterSettings(
        linear / 1e3,
        math.radians(angular),
        command_age=max_age,
        time_scale=time_scale,
        outside=not strict,
        desired_frame=frame,
    )
    loaded = load_model(model)
    check_arm(arm, loaded)
    answering = Prefilter(loaded, settings)
    place = BusSettings(endpoint, arm, namespace, "client", ros_domain, distro, config_file=config)
    with Bus(place, node=f"gpcorrect_prefilter_{arm}") as bus:
        server = FilterServer(answering, bus, open_logger(arm=arm))
        err.print(f"{model.name} corrects {bus.key('servo_cp')} on {place.where}; stop with Ctrl-C")
        server.run(stop)


def monitor(
    endpoint: Annotated[
        list[str] | None,
        typer.Option(help="Address of a robot or a service, repeatable; both on this machine without it."),
    ] = None,
    namespace: opt.KeyRoot = "gpcorrect",
    host: Annotated[str, typer.Option(help="Address to serve the page on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to serve the page on.", min=1, max=65535)] = 8080,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Serve on an address that other machines can reach.")
    ] = False,
    config: opt.Config = None,
    old_connect: opt.OldConnect = None,
) -> None:
    """Serve a page that shows every arm of a namespace: poses, correction, interval, domain, latency, drift, servers.

    The page reads and can change nothing.

    Example: gpcorrect monitor --endpoint tcp/127.0.0.1:7448 --endpoint tcp/127.0.0.1:7449

    gpcorrect monitor --config site/monitor.json5
    """
    for library in ("starlette", "uvicorn"):
        if find_spec(library) is None:
            raise MissingExtraError(library, extra="monitor", purpose="The page")
    if host not in ("127.0.0.1", "localhost", "::1") and not allow_remote:
        hint = "Serve on 127.0.0.1 and tunnel to it, or allow remote access on purpose: --allow-remote"
        raise DataError(f"{host} can be reached from other machines, and the page asks nobody who they are.", hint=hint)
    if config is not None and endpoint:
        raise DataError("--config and --endpoint both say where to look.", hint="Give one of them.")
    import uvicorn

    from gpcorrect_service.crtk import BusSettings, in_namespace
    from gpcorrect_service.monitor import Board, Watcher  # zenoh is an extra; other commands work without it
    from gpcorrect_service.monitor.app import application

    places = [BusSettings(one, namespace=namespace) for one in endpoint or [opt.ROBOT, opt.SERVICE]]
    if config is not None:
        places = [in_namespace(BusSettings(namespace=namespace, config_file=config))]
    board = Board(places[0].namespace)
    names = ["*"] if allow_remote else ["127.0.0.1", "localhost", "[::1]", host]
    page = application(board, names, lambda: server.should_exit)
    server = uvicorn.Server(uvicorn.Config(page, host, port, log_level="warning", timeout_graceful_shutdown=2))
    with Watcher(board, places):
        err.print(f"open http://{host}:{port}/ ; stop with Ctrl-C")
        server.run()
