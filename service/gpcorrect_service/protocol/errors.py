"""What can go wrong between planner and server, each with its status, cause and next step."""

from __future__ import annotations

from typing import Literal

from gpcorrect.errors import GpCorrectError

FailureStatus = Literal["BAD_INPUT", "STALE", "BUSY", "NO_MODEL", "INTERNAL", "NO_SERVICE", "OTHER_MODEL"]


class ServiceError(GpCorrectError):
    """A query that got no correction.

    Parameters
    ----------
    status : str
        BAD_INPUT, STALE, BUSY, NO_MODEL or INTERNAL when a server said so; NO_SERVICE when none answered,
        OTHER_MODEL when the only answers came from another model than the stream is held to.
    message, hint : str, cause and next step, a sentence each
    request_id : str, optional, the request as the server's log names it
    """

    def __init__(self, status: FailureStatus, message: str, *, hint: str = "", request_id: str = "") -> None:
        super().__init__(message, hint=hint)
        self.status = status
        self.request_id = request_id

    def __str__(self) -> str:
        return f"{self.status}: {super().__str__()}"


def bad_input(cause: str, next_step: str = "") -> ServiceError:
    """Return the refusal of a request that cannot be meant.

    Parameters
    ----------
    cause, next_step : str, a sentence each
    """
    return ServiceError("BAD_INPUT", cause, hint=next_step)


class EndpointError(GpCorrectError):
    """A network address that cannot be used.

    Parameters
    ----------
    endpoint : str, the address, as `tcp/127.0.0.1:7449`
    message, hint : str, see :class:`gpcorrect.errors.GpCorrectError`
    """

    def __init__(self, endpoint: str, message: str, *, hint: str = "") -> None:
        super().__init__(f"{endpoint}: {message}", hint=hint)
        self.endpoint = endpoint
