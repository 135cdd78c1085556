"""The live stream of joints: the robot's `measured_js` in, true joints and their spread out on `estimate`."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import zenoh

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect_service.ops.logger import Journal
from gpcorrect_service.ops.metrics import Tally
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.bounds import RateBound
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.wire_joints import JointEstimate, JointState
from gpcorrect_service.server.active import Active
from gpcorrect_service.server.joints import checked_joints
from gpcorrect_service.server.models import JointModel, JointStreamLike
from gpcorrect_service.server.queues import Lane

__all__ = ["Estimator", "StreamSample", "stream_lane", "stream_receiver"]

CLOCK_STEP = 1.0  # s that a stamp may lie behind the one before and still be a late sample; more is another clock
SAMPLES_WAITING = 1000  # a second of a fast robot: the slack needs every sample, and a late one says that it is
QUIET = 1000  # refused samples between two lines about them in the journal


class StreamSample(msgspec.Struct, frozen=True):
    """A sample as it came: bytes, zenoh encoding, and when it arrived (s, monotonic)."""

    payload: bytes
    encoding: str
    arrived: float


class Estimator:
    """Answers the samples of one arm's stream, one after the other, in one thread.

    Parameters
    ----------
    active : Active
        The models, and whether they may answer.
    replica : str
        Name that the estimates carry.
    tally : Tally
        Where samples are counted.
    journal : Journal
        Where refused samples are told, the first and every thousandth.
    monotonic : callable
        Clock, s.
    max_age : float
        s after which an estimate is called STALE.
    rate : float
        Largest change of a correction, rad/s and m/s; infinite for none.
    """

    def __init__(
        self,
        active: Active,
        *,
        replica: str,
        tally: Tally,
        journal: Journal,
        monotonic: Callable[[], float],
        max_age: float,
        rate: float = np.inf,
    ) -> None:
        self._active = active
        self._replica = replica
        self._tally = tally
        self._journal = journal
        self._monotonic = monotonic
        self._max_age = max_age
        self._rate = rate
        self._refused = 0
        self._model: JointModel | None = None
        self._stream: JointStreamLike | None = None
        self._bound: RateBound | None = None
        self._last: JointState | None = None

    def estimate(self, sample: StreamSample) -> tuple[bytes, str] | None:
        """Return the estimate's bytes and encoding, or None for a sample that is refused, which is counted."""
        try:
            codec = wire.choose_codec(sample.encoding, "joint_state")
            state = codec.decode(JointState, sample.payload)
            message = self._answer(state, self._monotonic() - sample.arrived)
        except (ServiceError, DataError) as error:
            self._refuse(error, sample.arrived)
            return None
        self._tally.add("estimate", message.status, self._monotonic() - sample.arrived)
        return codec.encode(message), wire.NAMES[codec.name, "estimate"]

    def _answer(self, state: JointState, age: float) -> JointEstimate:
        model = self._active.joint_model()
        q = checked_joints((state.position,), model.types, "joints")[0]
        effort = _effort(state, len(q))
        stream = self._stream_for(model, state)
        answer = stream.estimate(state.stamp, q, effort)
        self._last = state
        position, status = answer.q, "OK"
        if self._bound is not None:
            correction, cut = self._bound.step(state.stamp, answer.q - q)
            position, status = q + correction, ("LIMITED" if cut else "OK")
        if not np.isfinite(position).all():
            status = "MISSING"
        elif age > self._max_age:
            status = "STALE"
        return JointEstimate(
            state.stamp,
            wire.gaps(position.tolist()),
            wire.gaps(answer.std.tolist()),
            status,
            state.session,
            model.hash,
            self._replica,
        )

    def _stream_for(self, model: JointModel, state: JointState) -> JointStreamLike:
        """Return the path that this sample goes on with; it begins anew with a model, a session or another clock."""
        last = self._last
        if not (np.isfinite(state.stamp) and state.stamp > 0):
            raise ServiceError("BAD_INPUT", f"the stamp of the sample is {state.stamp}.", hint="Stamp samples in s.")
        if self._stream is None or model is not self._model:
            self._model, self._stream = model, model.stream()
            self._bound = RateBound(np.full(len(model.types), self._rate)) if np.isfinite(self._rate) else None
        elif last is not None and (state.session != last.session or state.stamp < last.stamp - CLOCK_STEP):
            self._stream.reset()
            if self._bound is not None:
                self._bound.reset()
        elif last is not None and state.stamp <= last.stamp:
            raise ServiceError(
                "BAD_INPUT",
                f"a sample stamped {state.stamp:.6f} came after one stamped {last.stamp:.6f}.",
                hint="Send every sample once, in order.",
            )
        return self._stream

    def _refuse(self, error: ServiceError | DataError, arrived: float) -> None:
        status = error.status if isinstance(error, ServiceError) else "BAD_INPUT"
        self._tally.add("estimate", status, self._monotonic() - arrived)
        if self._refused % QUIET == 0:
            self._journal.warning("sample refused", status=status, cause=error.message, refused=self._refused + 1)
        self._refused += 1


def stream_lane(
    session: zenoh.Session, key: str, estimator: Estimator, tally: Tally, journal: Journal
) -> Lane[StreamSample]:
    """Return the lane that answers samples and publishes the estimates on `key`; what finds it full is only counted."""
    # Not express: a packet for every estimate fills the two packets that zenoh holds, and more would be dropped.
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)

    def publish(sample: StreamSample) -> None:
        answer = estimator.estimate(sample)
        if answer is not None:
            publisher.put(answer[0], encoding=answer[1])

    def drop(_: StreamSample) -> None:
        tally.add("estimate", "DROPPED")

    return Lane("estimate", publish, drop, workers=1, capacity=SAMPLES_WAITING, journal=journal)


def stream_receiver(
    active: Active, lane: Lane[StreamSample], monotonic: Callable[[], float]
) -> Callable[[zenoh.Sample], None]:
    """Return the callback that queues samples, while there is a model to answer them."""

    def receive(sample: zenoh.Sample) -> None:
        if active.now.joints is not None:
            lane.offer(StreamSample(sample.payload.to_bytes(), str(sample.encoding), monotonic()))

    return receive


def _effort(state: JointState, dof: int) -> FloatArray | None:
    if state.effort is None:
        return None
    if len(state.effort) != dof:
        raise ServiceError(
            "BAD_INPUT",
            f"{dof} joints came with {len(state.effort)} efforts.",
            hint="Send one effort a joint, or none.",
        )
    effort = np.array(state.effort, dtype=np.float64)
    return np.where(np.isfinite(effort), effort, np.nan)
