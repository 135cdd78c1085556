"""The stream: the robot's `measured_js` come in, and true joints and their spread go out on `estimate`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpcorrect.calibration import JointStream
from gpcorrect.correction import Reason
from gpcorrect.errors import DataError
from gpcorrect_service.ops.metrics import Counters
from gpcorrect_service.protocol import limits, messages
from gpcorrect_service.protocol.answer import EstimateAnswer, pack
from gpcorrect_service.protocol.bounds import RateBound, StreamClock
from gpcorrect_service.protocol.errors import ServiceError, bad_input
from gpcorrect_service.server.models import JointModel
from gpcorrect_service.server.requests import Request, RequestParser

CLOCK_STEP = 1.0  # chosen by hand: s that a stamp may lie behind the one before and be late; more is another clock
LOG_EVERY = 1000  # refused samples between two lines about them in the log
SKIPPED_FROM = 0.2
"""Of the age at which an estimate is STALE, from which a sample that others wait behind gets none: what came together
is all answered, and a backlog does not make every estimate old. Chosen by hand."""


class Estimator:
    """Answers the samples of one arm's stream, one after the other, in one thread.

    Of refused samples the first and every thousandth are logged.
    """

    def __init__(self, parser: RequestParser, counters: Counters) -> None:
        self._active, self._settings, self._logger = parser.active, parser.settings, parser.logger
        self._counters, self._monotonic = counters, parser.clock.monotonic
        self._refused = 0
        self._model: JointModel | None = None
        self._stream: JointStream | None = None
        self._bound: RateBound | None = None
        self._last: messages.JointState | None = None
        self._clock = StreamClock()

    def estimate(self, sample: Request, *, newest: bool = True) -> tuple[bytes, str] | None:
        """Return the estimate's bytes and encoding, or None for a sample that is refused or skipped, which is counted.

        Parameters
        ----------
        sample : Request, bytes, zenoh encoding, and when it arrived
        newest : bool, whether no other sample waits behind it; an old one before others moves the slack, and no more
        """
        try:
            codec = messages.codec_of(sample.encoding, "joint_state")
            state = codec.decode(messages.JointState, sample.payload)
            message = self._answer(state, sample.arrived, newest=newest)
        except (ServiceError, DataError) as error:
            self._refuse(error, sample.arrived)
            return None
        seconds = self._monotonic() - sample.arrived
        if message is None:
            self._counters.add("estimate", "SKIPPED", seconds)
            return None
        self._counters.add("estimate", message.status, seconds, rows=1, outside=not message.in_domain)
        return codec.encode(message), codec.encoding("estimate")

    def _answer(self, state: messages.JointState, arrived: float, *, newest: bool) -> EstimateAnswer | None:
        model = self._active.joint_model()
        q = limits.checked_joints((state.position,), model.corrector.types)[0]
        effort = None if state.effort is None else limits.checked_rows((state.effort,), len(q), "efforts")[0]
        # What waited outside of this process, in a socket while it was stopped, came fresh by its arrival alone.
        left = arrived - self._clock.delay(limits.checked_stamp(state.stamp), arrived)
        stream = self._stream_for(model, state)
        most = self._settings.stream_max_age
        if not newest and self._monotonic() - left > SKIPPED_FROM * most:
            stream.follow(state.stamp, q, effort)
            self._last = state
            return None
        answer = stream.correct(state.stamp, q, effort)
        self._last = state
        if self._settings.strict:
            limits.check_inside(answer)
        assert answer.joints is not None
        if self._bound is not None:
            correction, cut = self._bound.step(state.stamp, answer.joints - q)
            answer = replace(answer, joints=q + correction).because(Reason.RATE_LIMITED, cut)
        answer = answer.because(Reason.STALE, self._monotonic() - left > most)
        beside = {"stamp": state.stamp, "session": state.session, "model_hash": model.hash}
        return pack(EstimateAnswer, answer, replica=self._settings.replica, **beside)

    def _stream_for(self, model: JointModel, state: messages.JointState) -> JointStream:
        """Return the path that this sample goes on with; it begins anew with a model, a session or another clock."""
        last, rate = self._last, self._settings.stream_rate
        if self._stream is None or model is not self._model:
            _check_estimates(model)
            self._model, self._stream = model, model.corrector.stream()
            self._bound = RateBound(rate) if np.isfinite(rate) else None
        elif last is not None and (state.session != last.session or state.stamp < last.stamp - CLOCK_STEP):
            # Not the clock: a sample that waited while the arm was homed is as old as it is.
            self._stream.reset()
            if self._bound is not None:
                self._bound.reset()
        elif last is not None and state.stamp <= last.stamp:
            hint = "Send every sample once, in order."
            raise bad_input(f"a sample stamped {state.stamp:.6f} came after one stamped {last.stamp:.6f}.", hint)
        return self._stream

    def _refuse(self, error: ServiceError | DataError, arrived: float) -> None:
        status = error.status if isinstance(error, ServiceError) else "BAD_INPUT"
        self._counters.add("estimate", status, self._monotonic() - arrived)
        if self._refused % LOG_EVERY == 0:
            self._logger.warning("sample refused", status=status, cause=error.message, refused=self._refused + 1)
        self._refused += 1


def _check_estimates(model: JointModel) -> None:
    """Refuse a model that answers another question than where the reported joints really are."""
    info = model.corrector.info()
    direction, signal = info.get("direction", "estimate"), info.get("input", "measured_jp")
    if direction != "estimate" or signal != "measured_jp":
        what = "says what to command" if direction != "estimate" else f"was learned from {signal}"
        cause = f"joint model {model.id} {what}, and measured_js holds what the robot reports."
        hint = "Estimates need a model of reported joints: gpcorrect joint fit --input measured_jp"
        raise ServiceError("NO_MODEL", cause, hint=hint)
