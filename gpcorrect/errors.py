"""The errors a user can cause: each says what was expected, what came, and what to do."""

from __future__ import annotations


class GpCorrectError(Exception):
    """Base of every error that bad input or a bad environment can cause.

    Parameters
    ----------
    message : str
        What went wrong, in one sentence: what was expected and what came.
    hint : str, optional, what to do about it
    """

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message} {self.hint}".strip()

    def __reduce__(self) -> tuple[object, ...]:
        """Come whole out of another process, whatever a subclass asks for at its making."""
        return _again, (type(self), self.args, self.__dict__)


def _again(kind: type[GpCorrectError], args: tuple[object, ...], state: dict[str, object]) -> GpCorrectError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


class DataError(GpCorrectError, ValueError):
    """Arrays or parameters of the wrong shape, range or unit."""


class LogError(GpCorrectError, ValueError):
    """A recording that cannot be read or does not hold what is needed.

    Parameters
    ----------
    message, hint : str, see :class:`GpCorrectError`
    path : str
        The file that was read, empty when the log never was a file.
    """

    def __init__(self, message: str, *, hint: str = "", path: str = "") -> None:
        super().__init__(f"{path}: {message}" if path else message, hint=hint)
        self.path = path


class DegenerateError(DataError):
    """Data that do not determine the answer (collinear points, no rotation, nothing moves)."""


class ArtifactError(GpCorrectError):
    """A model file that is truncated, altered, of another schema, or not a model file."""


class MissingExtraError(GpCorrectError, ImportError):
    """An optional library is not installed.

    Parameters
    ----------
    library : str, name of the library that is missing
    extra : str, extra of this package that brings it
    purpose : str, what the library is needed for
    """

    def __init__(self, library: str, *, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs {library}, which is not installed.", hint=f"Run: pip install 'gpcorrect[{extra}]'"
        )
        self.extra = extra
