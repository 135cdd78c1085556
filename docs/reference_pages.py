"""mkdocs hook: decisions and API reference in the navigation, and a page of the reference for every package."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("gpcorrect", "service/gpcorrect_service", "studies/gpcorrect_studies")


def on_config(config: Any) -> Any:
    """Put decisions and reference at the end of the navigation."""
    decisions = sorted(path.name for path in (ROOT / "docs" / "design").glob("*.md"))
    config.nav.append({"Decisions": [f"design/{name}" for name in decisions]})
    config.nav.append({"Reference": [{name: f"reference/{name}.md"} for name in names()]})
    return config


def on_files(files: Files, config: Any) -> Files:
    """Make the pages, a package or module of the first two levels each."""
    for name, documented in names().items():
        text = "\n\n".join([f"# {name}", *(f"::: {module}" for module in documented)])
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    return files


def names() -> dict[str, list[str]]:
    """Return the page of each package and what is on it: the package, or its modules where it exports nothing."""
    pages: dict[str, list[str]] = {}
    for package in map(ROOT.joinpath, PACKAGES):
        pages[package.name] = [package.name, *modules(package, package.name)]
        for folder in sorted(path.parent for path in package.glob("*/__init__.py")):
            name = f"{package.name}.{folder.name}"
            pages[name] = [name] if exports(folder / "__init__.py") else [name, *modules(folder, name)]
    return pages


def modules(folder: Path, package: str) -> list[str]:
    """Return the public modules of a folder."""
    return [f"{package}.{path.stem}" for path in sorted(folder.glob("*.py")) if not path.stem.startswith("_")]


def exports(path: Path) -> bool:
    """Tell whether a module says what it exports."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return any(isinstance(node, ast.Assign) and "__all__" in ast.unparse(node.targets[0]) for node in tree.body)
