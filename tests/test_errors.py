"""The errors a user can cause come whole out of another process, where parallel jobs raise them."""

from __future__ import annotations

import pickle

import pytest

from gpcorrect.errors import DataError, GpCorrectError, LogError, MissingExtraError
from gpcorrect_service import ServiceError
from gpcorrect_service.protocol.errors import EndpointError


@pytest.mark.parametrize(
    "error",
    [
        DataError("2 joints came.", hint="Give 3."),
        LogError("no time.", hint="Add it.", path="a.csv"),
        MissingExtraError("zenoh", extra="service", purpose="Serving"),
        ServiceError("NO_SERVICE", "nobody answered.", hint="Start one.", request_id="7"),
        EndpointError("tcp/x:1", "no such host.", hint="Name one."),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_comes_whole_out_of_another_process(error: GpCorrectError) -> None:
    again = pickle.loads(pickle.dumps(error))  # noqa: S301  # written in the line itself
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)
