"""The preview page in a real browser: python benchmarks/preview.py [PLAN …]

Without a plan, makes docs/preview.png from samples/coffee.jpg. With plans, prints for each the size of its page
and how soon Chromium shows it, in milliseconds from the start of the navigation: something at all (the poster),
the stage (decoded, ready to be used), every stroke painted. Needs the extra `dev` and Chromium (CHROMIUM says where,
if it is not on the path).
"""

from __future__ import annotations

import io
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from strokeplan.formats import load, write
from strokeplan.planner import plan
from strokeplan.preview import save_page
from strokeplan.strokes import StrokePlan

ROOT = Path(__file__).parent.parent
SAMPLE = ROOT / "samples" / "coffee.jpg"
PICTURE = ROOT / "docs" / "preview.png"
WINDOW: Any = {"width": 1120, "height": 700}
PICTURE_COLORS = 128
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
MARKS = "() => Object.fromEntries(['paint', 'mark'].flatMap((kind) => performance.getEntriesByType(kind))" + (
    ".map((entry) => [entry.name, entry.startTime]))"
)


def open_page(page: Page, strokes: StrokePlan, folder: Path) -> int:
    """Show a plan, painted; returns the bytes of its page."""
    path = folder / "preview.html"
    save_page(strokes, path)
    page.goto(path.as_uri())
    page.wait_for_selector("body[data-state=ready]", timeout=120_000)
    return path.stat().st_size


def picture(page: Page, folder: Path) -> None:
    """The page in the middle of the painting, one stroke chosen, as docs/preview.png."""
    strokes = plan(SAMPLE)
    open_page(page, strokes, folder)
    page.locator("#scrub").fill(str(strokes.layers[1].last))
    page.wait_for_selector(f'#picture[data-shown$=" {strokes.layers[1].last}"]', state="attached")
    page.locator("#scrub").blur()
    page.mouse.move(420, 270)
    page.wait_for_selector("body.chosen")
    with Image.open(io.BytesIO(page.screenshot())) as shot:
        stream = io.BytesIO()
        shot.convert("RGB").quantize(PICTURE_COLORS).save(stream, "PNG", optimize=True)
    write(PICTURE, stream.getvalue())


def measure(page: Page, path: Path, folder: Path) -> str:
    strokes = load(path)
    size = open_page(page, strokes, folder)
    marks = page.evaluate(MARKS)
    names = ("first-contentful-paint", "strokeplan-first-frame", "strokeplan-painted")
    times = " | ".join(f"{marks[name]:,.0f}" for name in names)
    return f"| {path.name} | {len(strokes):,} | {strokes.cubics:,} | {size / 1e6:.2f} | {times} |"


def main(paths: list[Path]) -> None:
    executable = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        page = browser.new_page(viewport=WINDOW, color_scheme="light")
        if not paths:
            picture(page, Path(folder))
        else:
            print("| plan | strokes | cubics | MB | first paint, ms | first frame, ms | painted, ms |")
            print("|---|---:|---:|---:|---:|---:|---:|")
        for path in paths:
            print(measure(page, path, Path(folder)))
        browser.close()


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]])
