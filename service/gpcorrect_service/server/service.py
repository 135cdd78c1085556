"""The server: zenoh callback -> bounded queue -> worker -> reply, or at once where nothing waits and it is quick."""

from __future__ import annotations

import gc
import math
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import msgspec
import zenoh
from threadpoolctl import threadpool_limits

from gpcorrect.calibration import CommandCorrector, ModelStore
from gpcorrect.errors import DataError
from gpcorrect_service.ops.logger import Logger, open_logger
from gpcorrect_service.ops.metrics import Counters, metrics_over_http
from gpcorrect_service.protocol.bounds import Throttle
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import JSON, Kind
from gpcorrect_service.protocol.sessions import live_key, open_server, wait_for
from gpcorrect_service.protocol.settings import ServerSettings
from gpcorrect_service.server import models
from gpcorrect_service.server.estimator import Estimator
from gpcorrect_service.server.handlers import Admin, Corrections, Health
from gpcorrect_service.server.queues import WorkerQueue
from gpcorrect_service.server.requests import CORRECTIONS, Clock, Handler, Request, RequestParser, Response, refusal
from gpcorrect_service.server.ros_service import RosService, open_ros
from gpcorrect_service.server.store_watch import StoreWatch

REFUSALS = 4096  # chosen by hand: BUSY answers that may wait to be sent; beyond it queries end without one
# s, a tenth of Python's own: a thread that loads a model hands the interpreter over when a query waits for it.
SWITCH_SECONDS = 5e-4
SAMPLES_WAITING = 1000  # a second of a fast robot: the slack needs every sample, and a late one says that it is
LAST_MOMENT = 0.2  # s: handing a full queue to the refusals takes a millisecond


class Job(msgspec.Struct, frozen=True, eq=False):
    """A query on its way through a queue: what answers or refuses it and on which key; arrived at s, monotonic."""

    query: zenoh.Query
    kind: Kind
    key: str
    handler: Handler
    arrived: float
    refuse: Callable[[Request, ServiceError, str], Response] = refusal


class Server:
    """Serves the models of one arm; a context manager.

    Queries enter through zenoh's callbacks, which queue them, all but a single pose for a quick model that finds
    nothing waiting: that is corrected there. Every key has its own queue and thread,
    so a long path does not delay a single pose and `health` answers while the others are flooded; refusals
    are sent by a thread of their own. A stopped server is not started again.

    Parameters
    ----------
    corrector : CommandCorrector, Model or None, what answers poses; None answers NO_MODEL
    settings : ServerSettings, optional
    joints : JointModel, optional
    store : ModelStore or StoreWatch, optional
        From where models can be activated, or what watches it already.
    logger : Logger, optional, standard error by default
    clock : Clock, optional

    Raises
    ------
    ArtifactError
        The models were learned on different arms, or on a sister of this one.
    """

    def __init__(
        self,
        corrector: CommandCorrector | models.Model | None,
        settings: ServerSettings | None = None,
        *,
        joints: models.JointModel | None = None,
        store: ModelStore | StoreWatch | None = None,
        logger: Logger | None = None,
        clock: Clock | None = None,
    ) -> None:
        given = settings or ServerSettings()
        # Named here and not with the settings, which may have been written in another process.
        self.settings = replace(given, replica=given.replica or f"{socket.gethostname()}-{os.getpid()}")
        model = corrector if isinstance(corrector, models.Model) or corrector is None else models.Model(corrector)
        models.check_arm(self.settings.arm, model, joints)
        self.active = models.Active(model, joints)
        self._watch: StoreWatch | None = StoreWatch(store) if isinstance(store, ModelStore) else store
        self._clock = clock or Clock()
        self._logger = logger or open_logger(arm=self.settings.arm, replica=self.settings.replica)
        self._counters = Counters()
        self._queues: dict[str, WorkerQueue[Any]] = {}
        self._refusals = WorkerQueue("refusals", self._refuse, self._drop, capacity=REFUSALS, logger=self._logger)
        self._throttle = Throttle(self.settings.max_rate)
        self._session: zenoh.Session | None = None
        self._token: Any = None
        self._queryables = ExitStack()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Listen, and answer from now on; EndpointError where the address is taken or cannot be used."""
        self.follow_store()
        with ExitStack() as stack:
            stack.enter_context(threadpool_limits(limits=1))
            session = stack.enter_context(open_server(self.settings))
            s = self.settings
            parser = RequestParser(self.active, s, self._logger, self._clock)
            ros_session = None if s.ros_domain is None else stack.enter_context(open_ros(s))
            health = Health(parser, self._counters, self._queues)
            if s.metrics_port is not None:
                stack.enter_context(metrics_over_http(s.metrics_port, health.metrics))
            stack.callback(self._drain)
            self._declare(session, ros_session, parser, health)
            self._stack = stack.pop_all()
        named = (("model", self.active.pose), ("joint_model", self.active.joints))
        facts = {f"{what}_{part}": getattr(m, part) for what, m in named if m for part in ("id", "hash")}
        self._logger.info("serving", endpoint=str(s.config_file or s.endpoint), **(facts or {"model_id": ""}))

    def follow_store(self) -> None:
        """Do what the store says since the last look: while this server was down or hung, for one."""
        if self._watch is not None:
            self._watch.look(self.active, self.settings.arm, self._logger, self._announce)

    def stop(self) -> None:
        """Take no more queries, answer those that wait (at most `drain_seconds`), and close."""
        self._queryables.close()
        self._stack.close()
        self._logger.info("stopped", counts=self._counters.counts())

    def _drain(self) -> None:
        """Let the workers finish; hand what they cannot finish in time to the refusals; end those last."""
        until = time.monotonic() + self.settings.drain_seconds
        queues = self._queues.values()
        for queue in queues:
            queue.close()
        in_time = [queue.join(until) for queue in queues]
        for queue in queues:
            queue.hurry()
        ended = [queue.join(until + LAST_MOMENT) for queue in queues]
        self._refusals.close()
        self._refusals.join(until + 2 * LAST_MOMENT)
        if not all(in_time):
            self._logger.warning("did not finish in time", hanging=ended.count(False))

    def _declare(
        self, session: zenoh.Session, ros_session: zenoh.Session | None, parser: RequestParser, health: Health
    ) -> None:
        """Declare the keys, the operator's and the monitor's last: who sees them finds the rest answering."""
        self._refusals.start()
        if self._watch is not None or self.active.joints is not None:
            self._declare_stream(session, parser)
        s = self.settings
        corrections = Corrections(parser).handlers()
        admin = Admin(parser, None if self._watch is None else self._watch.store, self._announce)
        for kind, handler in {**corrections, **health.handlers(), **admin.handlers()}.items():
            self._declare_key(session, kind, handler)
        if ros_session is not None:
            ros = RosService(s, corrections["correct"], self._clock)
            receive = self._receiver("correct", ros.key, ros.answer, ros.refuse)
            ros.declare(ros_session, receive, self._queryables, self._logger)
        with self.active.changing:
            self._session = session
            self._announce()
        self._queryables.callback(lambda: self._token.undeclare())  # noqa: PLW0108  # that of the moment

    def _announce(self) -> None:
        """Show that this server lives, and which models it holds; nobody before it listens."""
        if self._session is None:
            return
        before = self._token
        key = live_key(self.settings.arm, self.settings.replica, *self.active.hashes)
        self._token = self._session.liveliness().declare_token(key)
        if before is not None:
            before.undeclare()

    def _declare_key(self, session: zenoh.Session, kind: Kind, handler: Handler) -> None:
        s = self.settings
        queue: WorkerQueue[Job] = WorkerQueue(
            kind,
            self._answer,
            self._refusals.offer,
            capacity=s.queue_capacity,
            logger=self._logger,
            at_once=self._answers_at_once if kind == "correct" else lambda: False,
        )
        queue.start()
        self._queues[kind] = queue  # only now: a worker that does not run is a fault
        key = f"{s.arm}/{kind}"
        # A direct callback runs on zenoh's thread, and saves a change of threads.
        callback = zenoh.handlers.Callback(self._receiver(kind, key, handler, refusal), indirect=False)
        self._queryables.enter_context(session.declare_queryable(key, callback, complete=True))

    def _answers_at_once(self) -> bool:
        model = self.active.pose
        return model is not None and model.quick

    def _receiver(
        self, kind: Kind, key: str, handler: Handler, refuse: Callable[[Request, ServiceError, str], Response]
    ) -> Callable[[zenoh.Query], None]:
        """Return what puts the queries of a key into its queue."""
        queue, monotonic = self._queues[kind], self._clock.monotonic
        throttled = kind in CORRECTIONS and math.isfinite(self.settings.max_rate)

        def _receive(query: zenoh.Query) -> None:
            job = Job(query, kind, key, handler, monotonic(), refuse)
            refused = throttled and not self._throttle.passes(job.arrived)
            (self._refusals if refused else queue).offer(job)

        return _receive

    def _answer(self, job: Job) -> None:
        """Send what the job's handler returns; in a worker's thread, for replying may wait for the network."""
        with job.query as query:
            self._send(query, job, job.handler(_request(query, job.arrived)))

    def _refuse(self, job: Job) -> None:
        """Send BUSY, in the thread of the refusals."""
        s = self.settings
        cause = f"{s.queue_capacity} requests are waiting already, more came than --max-rate allows, or the server is"
        busy = ServiceError("BUSY", f"{cause} stopping.", hint="Ask again later, or add a replica.")
        with job.query as query:
            self._send(query, job, job.refuse(_request(query, job.arrived), busy, s.replica))

    def _drop(self, job: Job) -> None:
        """Let the query go without an answer, so that its client does not wait for one."""
        self._counters.add(job.kind, "DROPPED", None)
        with job.query:
            pass

    def _send(self, query: zenoh.Query, job: Job, response: Response) -> None:
        seconds = self._clock.monotonic() - job.arrived
        self._counters.add(job.kind, response.status, seconds, response.rows, response.outside)
        try:
            if response.is_error:
                query.reply_err(response.payload, encoding=response.encoding)
            else:
                # A queryable answers on its own concrete key.
                query.reply(job.key, response.payload, encoding=response.encoding, attachment=response.attachment)
        except zenoh.ZError as error:
            self._logger.warning("reply not sent", kind=job.kind, status=response.status, cause=str(error))

    def _declare_stream(self, session: zenoh.Session, parser: RequestParser) -> None:
        """Listen to the robot's joints, and publish estimates."""
        s, monotonic = self.settings, self._clock.monotonic
        estimator = Estimator(parser, self._counters)
        # Not express: a packet for every estimate fills the two packets that zenoh holds, and more would be dropped.
        drop = zenoh.CongestionControl.DROP
        publisher = session.declare_publisher(f"{s.arm}/estimate", congestion_control=drop)

        def _publish(sample: Request) -> None:
            answer = estimator.estimate(sample, newest=not queue.waiting)
            if answer is not None:
                publisher.put(answer[0], encoding=answer[1])

        def _dropped(_: Request) -> None:
            self._counters.add("estimate", "DROPPED", None)

        def _receive(sample: zenoh.Sample) -> None:
            if self.active.joints is not None:
                queue.offer(Request(sample.payload.to_bytes(), str(sample.encoding), b"", monotonic()))

        queue = WorkerQueue("estimate", _publish, _dropped, capacity=SAMPLES_WAITING, logger=self._logger)
        queue.start()
        self._queues["estimate"] = queue
        callback = zenoh.handlers.Callback(_receive, indirect=False)
        self._queryables.enter_context(session.declare_subscriber(f"{s.arm}/{s.stream_key}", callback))


def _request(query: zenoh.Query, arrived: float) -> Request:
    """Copy a query's bytes; a query without an encoding asks in JSON, as people do."""
    payload, attachment = query.payload, query.attachment
    return Request(
        payload=payload.to_bytes() if payload is not None else b"",
        encoding=str(query.encoding) if query.encoding is not None else JSON.media_type,
        attachment=attachment.to_bytes() if attachment is not None else b"",
        arrived=arrived,
    )


def serve(
    model_path: str | Path | None,
    settings: ServerSettings | None = None,
    stop_event: threading.Event | None = None,
    on_ready: Callable[[Server], None] | None = None,
    *,
    joint_path: str | Path | None = None,
    store: str | Path | None = None,
) -> None:
    """Serve model files until stopped: the whole life of a service process.

    Parameters
    ----------
    model_path : path or None, what `gpcorrect fit` wrote; None takes the active one of the store
    settings : ServerSettings, optional
    stop_event : threading.Event, optional
        Ends the service when set. Without it SIGTERM and SIGINT do, which needs the main thread.
    on_ready : callable, optional
    joint_path : path, optional
        What `gpcorrect joint fit` wrote; without it the active one of the store, where there is one.
    store : path, optional, folder of models that can be activated while serving

    Raises
    ------
    ArtifactError, DataError, EndpointError
        A model file is refused; there is nothing to serve; the address is taken or cannot be used.
    """
    folder = None if store is None else ModelStore(store)
    watch = None if folder is None else StoreWatch(folder)  # before models are read: later ones it takes over
    pose = models.load_model(model_path) if model_path is not None else _stored(folder, "pose")
    joints = models.load_joint_model(joint_path) if joint_path is not None else _stored(folder, "joints")
    if pose is None and joints is None and folder is None:
        raise DataError("there is nothing to serve.", hint="Name a model, --joints JOINT_MODEL, or --store FOLDER.")
    assert not isinstance(pose, models.JointModel)
    assert not isinstance(joints, models.Model)
    # What the process has loaded by now it keeps: the collector need not walk through it while a planner waits.
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_SECONDS)
    with _stop_signal(stop_event) as stop, Server(pose, settings, joints=joints, store=watch) as server:
        if on_ready is not None:
            on_ready(server)
        wait_for(stop, server.follow_store)


def _stored(store: ModelStore | None, kind: str) -> models.Model | models.JointModel | None:
    entry = None if store is None else store.active(kind)
    return None if store is None or entry is None else models.load_entry(store, entry)


@contextmanager
def _stop_signal(given: threading.Event | None) -> Iterator[threading.Event]:
    """Give the event that ends the service; without a given one the usual signals set it."""
    if given is not None:
        yield given
        return
    stop = threading.Event()
    before = {n: signal.signal(n, lambda *_: stop.set()) for n in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
