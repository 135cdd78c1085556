"""The map of the house, the registries, the documents' tables, the command line's help and how it is cited agree."""

from __future__ import annotations

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator
from typing import Any, get_args

import pytest
from command_line import PROGRAM
from support import ROOT

from gpcorrect.calibration import LEARNERS, HoldOut
from gpcorrect.calibration.settings import Direction
from gpcorrect.logs.reader import FORMATS
from gpcorrect.rigid import MarkerOption


def first_cells(page: str, head: str) -> Iterator[str]:
    """First cells of the table of a page whose first column has this title."""
    table = (ROOT / page).read_text().split(f"| {head} |", 1)[1].split("\n\n", 1)[0]
    for row in table.splitlines()[2:]:
        yield row.split("|")[1].strip()


def option_help(command: str, option: str) -> str:
    """Help of an option."""
    parameters = PROGRAM.command(*command.split()).params
    return str(next(p.help for p in parameters if f"--{option}" in p.opts))


def test_the_map_names_every_package() -> None:
    """Each package and each part of gpcorrect stands in the map of CONTRIBUTING.md, and nothing else does."""
    named = {name for cell in first_cells("CONTRIBUTING.md", "package") for name in re.findall(r"`([^`]+)`", cell)}
    folders = {f"gpcorrect.{path.parent.name}" for path in (ROOT / "gpcorrect").glob("*/__init__.py")}
    modules = {f"gpcorrect.{path.stem}" for path in (ROOT / "gpcorrect").glob("*.py")}
    assert folders <= named
    assert named <= folders | modules | {"gpcorrect_service", "gpcorrect_studies"}


def test_the_page_on_logs_names_every_format() -> None:
    """Every ending that is read stands in the table of formats."""
    told = " ".join(first_cells("docs/logs.md", "you have"))
    assert {suffix for kind in FORMATS for suffix in kind.suffixes if f"`{suffix}`" not in told} == {".pq"}


def test_the_page_on_joints_lists_the_methods() -> None:
    """The table of methods has a row for every learner."""
    listed = {name for cell in first_cells("docs/joint.md", "`--method`") for name in re.findall(r"`([^`]+)`", cell)}
    assert listed == set(LEARNERS)


@pytest.mark.parametrize(
    ("command", "option", "names"),
    [
        ("joint fit", "method", tuple(LEARNERS)),
        ("joint fit", "direction", get_args(Direction)),
        ("joint fit", "hold-out-by", tuple(HoldOut)),
        ("vision fit", "method", ("gp", "network", "linear")),
        ("fit", "marker", get_args(MarkerOption)),
    ],
)
def test_the_help_of_an_option_names_every_choice(command: str, option: str, names: tuple[str, ...]) -> None:
    """What an option takes can be read from its help."""
    assert set(names) <= set(re.findall(r"\w+", option_help(command, option)))


def test_the_documents_name_tests_that_exist() -> None:
    """A test that a page names is a file or a function of the tests."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    named = {name for page in pages for name in re.findall(r"\btest_[a-z0-9_]+", page.read_text())}
    files = [*(ROOT / "tests").rglob("test_*.py")]
    known = {path.stem for path in files}
    known |= {name for path in files for name in re.findall(r"^ *(?:async )?def (test_\w+)", path.read_text(), re.M)}
    assert named <= known


def test_what_shows_a_hazard_is_there() -> None:
    """Every test, bench and group of scenarios that the table of hazards names exists."""
    page = (ROOT / "docs" / "risk.md").read_text()
    files = {path.stem for path in ROOT.glob("tests/**/test_*.py")}
    groups = {path.stem for folder in ("attacks", "fuzzing") for path in (ROOT / "bench" / folder).glob("*.py")}
    assert set(re.findall(r"\btest_\w+", page)) <= files
    assert set(re.findall(r"--only (\w+)", page)) <= groups
    assert all((ROOT / path).exists() for path in re.findall(r"`((?:tests|bench)/[\w/]+(?:\.py)?)", page))


def test_scripts_import_what_is_there() -> None:
    """Every name that a script of bench/ takes from another one, or from the packages, exists."""
    bench = ROOT / "bench"
    trees = {path: ast.parse(path.read_text()) for path in bench.rglob("*.py")}
    taken = [
        (path, node.module, alias.name)
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    ]
    for path, module, name in taken:
        place = bench / module.replace(".", "/")
        if (tree := trees.get(place.with_suffix(".py"))) is not None:
            assert name in _defined(tree), f"{path} takes {name} from {module}"
        elif module.split(".")[0].startswith("gpcorrect") and not hasattr(importlib.import_module(module), name):
            importlib.import_module(f"{module}.{name}")


def _defined(tree: ast.Module) -> set[str]:
    """Names that a module binds at its top."""
    found = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}
    return found


@pytest.fixture
def cited() -> dict[str, Any]:
    """Return how the project is cited."""
    yaml = pytest.importorskip("yaml", reason="PyYAML reads CITATION.cff; it comes with the documents' tools")
    return yaml.safe_load((ROOT / "CITATION.cff").read_text())


def test_the_citation_is_of_this_version_and_names_the_studies(cited: dict[str, Any]) -> None:
    """Version and abstract are the package's; each study that is done again stands among the references."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (cited["version"], cited["abstract"]) == (project["version"], project["description"])
    assert {"cff-version", "message", "title", "authors"} <= set(cited)
    for claims in sorted((ROOT / "studies").rglob("claims.toml")):
        head = re.sub(r"\s*\n# ", " ", claims.read_text().partition("\n\n")[0]).casefold()
        assert any(reference["title"].casefold() in head for reference in cited["references"]), claims


def test_no_licence_is_claimed_that_the_owner_did_not_give(cited: dict[str, Any]) -> None:
    """A licence stands in CITATION.cff only where pyproject.toml has one."""
    assert ("license" in cited) == ("license" in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"])
