"""Pictures of the pages that people see, wide and narrow, light and dark, for docs/gallery.md.

    gpcorrect monitor &      # and whatever else is to be shown
    python bench/gallery.py fit=demo_output/report/report.html debride=demo_output/task.html monitor=http://127.0.0.1:8080/

Every page is opened in Chromium, must not complain on the console nor be wider than its window, and is written with few
colours, so that the folder stays below 3 MB.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests"))
from chromium import Page, browser  # noqa: E402 - of the tests

SIZES = {1280: 1500, 390: 1500}  # px: widths, and how much of a page's height is shown
COLOURS = 96
SETTLED = 2.0  # s for pictures and scripts of a page


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="+", help="NAME=FILE or NAME=URL")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images" / "gallery")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    faults = 0
    with tempfile.TemporaryDirectory() as profile, browser(Path(profile)) as page:
        for name, _, place in (text.partition("=") for text in arguments.pages):
            url = place if "://" in place else Path(place).resolve().as_uri()
            for width, height in SIZES.items():
                for scheme in ("light", "dark"):
                    path = arguments.output / f"{name}-{width}-{scheme}.png"
                    wide = shoot(page, url, width, height, scheme, path)
                    faults += wide > width
                    print(f"{path.name:32} {path.stat().st_size / 1e3:6.0f} kB" + (f"  {wide} px!" * (wide > width)))
    print(*page.complaints, sep="\n")
    return int(faults > 0 or bool(page.complaints))


def shoot(page: Page, url: str, width: int, height: int, scheme: str, path: Path) -> int:
    """Write one picture; return how wide the page's content is, px."""
    page._call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    page.open(url, width, height)
    page.wait_for("document.readyState == 'complete'")
    time.sleep(SETTLED)
    wide = int(page.run("document.documentElement.scrollWidth"))
    page._call("Page.captureScreenshot", format="png")  # a first one loads what is drawn late
    page.picture(path)
    picture = Image.open(path).convert("RGB")
    picture.crop((0, 0, width, min(height, picture.height))).quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(
        path, optimize=True
    )
    return wide


if __name__ == "__main__":
    raise SystemExit(main())
