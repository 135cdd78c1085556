from __future__ import annotations

import doctest
import re
import tomllib
from dataclasses import fields

from support import ROOT

from gpcorrect.logs.columns import ColumnMap
from gpcorrect.logs.native import format_sidecar
from gpcorrect.types import LogMeta

PAGE = ROOT / "docs" / "logs.md"


def test_the_pages_examples_do_what_they_say():
    failed, tried = doctest.testfile(str(PAGE), module_relative=False)
    assert tried > 15
    assert failed == 0


def test_the_pages_mapping_files_are_accepted_and_its_sidecar_uses_known_keys():
    blocks = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)]
    sidecars = [block for block in blocks if "robot" in block]
    assert len(sidecars) == 1
    assert set(sidecars[0]) <= {f.name for f in fields(LogMeta)} | {"T_tracker_base"}
    assert format_sidecar(LogMeta(tracker_base=(0.0,) * 6)).startswith("[T_tracker_base]")
    for block in blocks:
        if block not in sidecars:
            ColumnMap.model_validate(block)
