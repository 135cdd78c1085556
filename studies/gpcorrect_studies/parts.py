"""Parts of a study that are done, in a file: a run that was ended goes on where it stopped."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from gpcorrect.atomic import write_file
from gpcorrect.parallel import each
from gpcorrect.plain import json_ready
from gpcorrect.types import Progress

Item = TypeVar("Item")


class Parts:
    """Results by name, each written down as soon as it is there.

    The file has a line for what is run, then one for each part. It is gone on with where the same version runs the same
    study with the same settings, and begun anew otherwise.

    Parameters
    ----------
    path : Path, optional, file of JSON lines; nothing is written without one
    run : mapping, optional, what is run: study, scope, seed
    """

    def __init__(self, path: Path | None = None, run: Mapping[str, Any] | None = None) -> None:
        self._path, self._values = path, dict[str, Any]()
        self.seconds_before, self._clock = 0.0, time.perf_counter()
        head = json_ready({"version": version("gpcorrect"), **(run or {})})
        lines = _whole_lines(path)
        if not lines or lines[0] != head:
            lines = [head]
        for line in lines[1:]:
            self._values[line["part"]] = line["value"]
            self.seconds_before += line["seconds"]
        if path is not None:
            write_file(path, "".join(json.dumps(line) + "\n" for line in lines))

    @property
    def count(self) -> int:
        """Number of parts that are there."""
        return len(self._values)

    def done(self, name: str, make: Callable[[], Any]) -> Any:
        """Return a part: as it was written down, or made now.

        Parameters
        ----------
        name : str
        make : callable
            Returns what JSON can hold; keys become text and tuples lists, whether it is made now or was before.
        """
        return self._values[name] if name in self._values else self.keep(name, make())

    def keep(self, name: str, value: Any) -> Any:
        """Write a part down and return it, as a run that goes on would have it.

        Parameters
        ----------
        name : str
        value : Any, what JSON can hold
        """
        value = self._values[name] = json_ready(value)
        spent, self._clock = time.perf_counter() - self._clock, time.perf_counter()
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"part": name, "seconds": spent, "value": value}) + "\n")
        return value

    def each(
        self, stage: str, function: Callable[[Item], Any], items: Mapping[str, Item], progress: Progress
    ) -> dict[str, Any]:
        """Return `function(item)` of every item by its name; those that are not there yet may be done side by side.

        Parameters
        ----------
        stage : str, name of the whole, for `progress` and before the names of its parts
        function : callable, as :func:`gpcorrect.parallel.each` has it; returns what JSON can hold
        items : mapping
        progress : Progress, receives a step before the first part and after each
        """
        progress.step(stage, 0.0)
        missing = {name: item for name, item in items.items() if f"{stage}: {name}" not in self._values}
        for name, value in zip(missing, each(function, missing.values(), progress, stage), strict=True):
            self.keep(f"{stage}: {name}", value)
        return {name: self._values[f"{stage}: {name}"] for name in items}

    def remove(self) -> None:
        """Remove the file: the study is done, and its next run begins anew."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def _whole_lines(path: Path | None) -> Sequence[Any]:
    """Lines of a file as far as they are whole: the last one may have been cut."""
    lines: list[Any] = []
    if path is not None and path.is_file():
        for text in path.read_text(encoding="utf-8").splitlines():
            try:
                lines.append(json.loads(text))
            except ValueError:
                break
    return lines
