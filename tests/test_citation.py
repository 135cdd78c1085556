"""How the project is cited agrees with what it is."""

from __future__ import annotations

import re
import tomllib

import pytest
from support import ROOT

yaml = pytest.importorskip("yaml", reason="PyYAML reads CITATION.cff; it comes with the documents' tools")


def test_the_citation_is_of_this_version_and_names_the_studies() -> None:
    """Version and abstract are the package's; each study that is done again stands among the references."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (cited["version"], cited["abstract"]) == (project["version"], project["description"])
    assert {"cff-version", "message", "title", "authors"} <= set(cited)
    for claims in sorted((ROOT / "studies").rglob("claims.toml")):
        head = re.sub(r"\s*\n# ", " ", claims.read_text().partition("\n\n")[0]).casefold()
        assert any(reference["title"].casefold() in head for reference in cited["references"]), claims


def test_no_licence_is_claimed_that_the_owner_did_not_give() -> None:
    """A licence stands in CITATION.cff only where pyproject.toml has one."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert ("license" in yaml.safe_load((ROOT / "CITATION.cff").read_text())) == ("license" in project)
