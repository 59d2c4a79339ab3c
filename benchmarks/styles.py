"""Pictures of the styles and of the options beyond the paper: python benchmarks/styles.py [--all]

Writes docs/styles.md and docs/options.md with their pictures, all from samples/ and from two small pictures that
it draws itself. A picture that is there is kept; --all makes every one anew. Needs the extra `raster`.
"""

from __future__ import annotations

import io
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from strokeplan.figures import montage, shrink, side_by_side, spread_figure
from strokeplan.formats import write
from strokeplan.image import load_photo
from strokeplan.layer_fields import layer_field, layer_spread
from strokeplan.planner import plan
from strokeplan.presets import load_preset, names, style
from strokeplan.rendering import encode_png, render

Picture = NDArray[np.uint8]

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
STYLES, OPTIONS = DOCS / "styles", DOCS / "options"
SAMPLE = "samples/chelsea.jpg"
SHEET_SAMPLE = "samples/coffee.jpg"
"""The montage shows another photo than the samples do."""
TWO_COLOURS = "docs/options/two-colours.png"
MASK = "docs/options/mask.png"
SAMPLE_WIDTH, SHEET_WIDTH = 640, 1200
SAMPLE_BYTES, SHEET_BYTES = 100_000, 300_000
QUALITY, LEAST_QUALITY = 80, 40


@dataclass(frozen=True)
class Panel:
    """One plan of a picture and the part of it that is shown."""

    label: str
    photo: str
    preset: str
    settings: tuple[str, ...] = ()
    mask: str | None = None

    @property
    def command(self) -> str:
        words = ["strokeplan", "plan", self.photo, "-o", "out.png", "--preset", self.preset]
        for setting in self.settings:
            words += ["--set", setting]
        return shlex.join(words + (["--mask", self.mask] if self.mask else []))

    def paint(self, crop: Crop, width: int) -> Picture:
        """The part inside `crop`, so many pixels wide."""
        photo = load_photo(ROOT / self.photo)
        strokes = plan(photo, style(self.preset, list(self.settings)), mask=ROOT / self.mask if self.mask else None)
        left, top, right, bottom = crop
        scale = width / ((right - left) * photo.width)
        # Painted at twice the size, then reduced: strokes below a pixel keep their weight.
        picture = render(strokes, width=round(2 * scale * photo.width))
        rows, columns = picture.shape[:2]
        cut = picture[round(top * rows) : round(bottom * rows), round(left * columns) : round(right * columns)]
        return shrink(cut, 0.5)


Crop = tuple[float, float, float, float]
"""Left, top, right, bottom, in parts of the photo."""
WHOLE: Crop = (0, 0, 1, 1)


@dataclass(frozen=True)
class Option:
    """What one option does: a row of panels of one crop, and words."""

    name: str
    title: str
    text: str
    panels: tuple[Panel, ...]
    crop: Crop = WHOLE


ASTRONAUT, CHELSEA, COFFEE = "samples/astronaut.jpg", "samples/chelsea.jpg", "samples/coffee.jpg"
FACE: Crop = (0.3, 0.06, 0.62, 0.4)
FEW = ("gain=500",)
"""Few enough strokes to see where they go."""
SPREAD_SEED = (150.0, 215.0)
"""A point in the fur, where the orientation is unsure."""
WANDER = "strokeplan inspect samples/chelsea.jpg -o figures --wander 0.5 --count 50 --point 150,215"

BOLD = ("importance_strength=1", *FEW)
CHOICES = (
    Option(
        "channels",
        "Colour in the tensor",
        "Rings of red and green of one luminance, under bars of shade. Grey sees the bars alone; `lab` sees both, "
        "and goes with the stronger; `hue` goes with the rings, and only inside them, where there is no border, with "
        "the little that shade leaves in a hue.",
        tuple(
            Panel(f"`{channels}`", TWO_COLOURS, "flow", (f"channels={channels}", "layers.2.lightness_jitter=10"))
            for channels in ("grey", "lab", "hue")
        ),
    ),
    Option(
        "wander",
        "Tracts that wander",
        "As in probabilistic tractography a tract strays the further, the less sure the orientation is. "
        f"Fifty tracts through one point are drawn by `{WANDER}`:\n\n"
        "![Fifty tracts through one point of a photo](options/spread.jpg)\n\nAnd in a painting:",
        tuple(Panel(f"`wander = {wander}`", CHELSEA, "expressionist", (f"wander={wander}",)) for wander in (0, 0.5, 1)),
        (0.0, 0.35, 0.6, 1.0),
    ),
    Option(
        "importance",
        "Where detail matters",
        "Faces are found and get more and narrower strokes; a mask says the same of any place (here a white ellipse "
        "on the eyes, black elsewhere). Regions keep strokes from running across borders.",
        (
            Panel("as it is", ASTRONAUT, "fine", FEW),
            Panel("faces", ASTRONAUT, "fine", ('importance=["faces"]', *BOLD)),
            Panel("a mask", ASTRONAUT, "fine", BOLD, MASK),
            Panel("400 regions", ASTRONAUT, "fine", ("regions=400", *FEW)),
        ),
        FACE,
    ),
    Option(
        "seeding",
        "Where strokes are tried",
        "In cells in random order; in the worst cells first; at random where the error is; evenly spaced.",
        tuple(
            Panel(f"`{seeding}`", CHELSEA, "pointillist", (f"seeding={seeding}",))
            for seeding in ("grid", "worst-first", "error", "even")
        ),
        (0.3, 0.22, 0.56, 0.6),
    ),
    Option(
        "thin",
        "Strokes that hardly show are left out",
        "Strokes that differ from what lies below them by less than `thin`; `strokeplan info` counts what is left.",
        tuple(Panel(f"`thin = {thin}`", COFFEE, "fine", (f"thin={thin}",)) for thin in (0, 20, 60)),
        (0.3, 0.05, 0.85, 0.6),
    ),
    Option(
        "palette",
        "A palette",
        "Only so many colours, taken from the photo; `--palette 6` is short for it.",
        tuple(
            Panel(f"{size} colours" if size else "any colour", COFFEE, "gouache", (f"palette_size={size}",))
            for size in (6, 12, 0)
        ),
    ),
    Option(
        "jitter",
        "Broken colour",
        "Each stroke may depart from the photo in hue, chroma and lightness.",
        tuple(
            Panel(
                f"`hue_jitter = {hue}`",
                CHELSEA,
                "impressionist",
                tuple(f"layers.{layer}.hue_jitter={hue}" for layer in (1, 2, 3)),
            )
            for hue in (0, 15, 40)
        ),
        (0.2, 0.15, 0.8, 0.95),
    ),
    Option(
        "pressure",
        "Pressure of the brush",
        "A brush touches down and lifts, and goes lightly through bends. Pictures show it as width, SVG as outlines.",
        tuple(
            Panel(f"`pressure = {pressure}`", COFFEE, "impressionist", (f"pressure={pressure}",))
            for pressure in (0, 0.5, 1)
        ),
        (0.3, 0.1, 0.6, 0.4),
    ),
    Option(
        "averaging",
        "Calm flat areas",
        "Where there is no clear orientation the tensor is averaged over more and more, up to "
        "`max_integration_sigma`; at 0 strokes curl in the noise.",
        tuple(
            Panel(f"`max_integration_sigma = {widest}`", ASTRONAUT, "flow", (f"max_integration_sigma={widest}",))
            for widest in (0, 60)
        ),
        (0.1, 0.0, 0.9, 0.6),
    ),
)


def main() -> None:
    anew = "--all" in sys.argv[1:]
    for folder in (STYLES, OPTIONS):
        folder.mkdir(exist_ok=True)
    made = {ROOT / TWO_COLOURS: two_colours, ROOT / MASK: eyes_mask}
    for path, draw in made.items():
        write(path, encode_png(draw()))
    pictures: dict[Path, tuple[Callable[[], Picture], int]] = {
        STYLES / f"{name}.jpg": (lambda name=name: painted(SAMPLE, name, SAMPLE_WIDTH), SAMPLE_BYTES)  # type: ignore[misc]
        for name in names()
    }
    pictures[DOCS / "styles.jpg"] = (sheet, SHEET_BYTES)
    pictures[OPTIONS / "spread.jpg"] = (spread, SAMPLE_BYTES)
    for option in CHOICES:
        pictures[OPTIONS / f"{option.name}.jpg"] = (lambda option=option: row(option), SAMPLE_BYTES)  # type: ignore[misc]
    for path, (paint, most) in pictures.items():
        if anew or not path.exists():
            print(f"… {path.relative_to(ROOT)}", file=sys.stderr)
            write(path, jpeg(paint(), most))
    write(DOCS / "styles.md", styles_page().encode())
    write(DOCS / "options.md", options_page().encode())


def jpeg(picture: Picture, most: int) -> bytes:
    """A JPEG of at most so many bytes, by less quality where it must be."""
    for quality in range(QUALITY, LEAST_QUALITY - 1, -5):
        stream = io.BytesIO()
        Image.fromarray(picture).save(stream, "JPEG", quality=quality, optimize=True)
        if stream.tell() <= most:
            return stream.getvalue()
    raise SystemExit(f"a picture of {picture.shape[1]} × {picture.shape[0]} pixels does not fit {most} bytes")


def painted(photo: str, preset: str, width: int) -> Picture:
    return Panel("", photo, preset).paint(WHOLE, width)


def sheet() -> Picture:
    """All styles of one photo, by name, without the two of the paper."""
    shown = [name for name in names() if not name.startswith("paper")]
    columns = next((count for count in (5, 4, 3) if len(shown) % count == 0), 4)
    return montage([painted(SHEET_SAMPLE, name, SHEET_WIDTH // columns) for name in shown], columns=columns)


def row(option: Option) -> Picture:
    """The panels of an option side by side."""
    width = (1000 if len(option.panels) > 2 else 800) // len(option.panels)
    return side_by_side([panel.paint(option.crop, width) for panel in option.panels])


def spread() -> Picture:
    """What WANDER draws, smaller."""
    photo, preset = load_photo(ROOT / CHELSEA), load_preset("fine").override({"wander": 0.5})
    field = layer_field(photo, preset, 2)
    picture = spread_figure(photo, layer_spread(field, preset, 2, SPREAD_SEED, 50), SPREAD_SEED)
    return shrink(picture, SAMPLE_WIDTH / picture.shape[1])


def two_colours() -> Picture:
    """Rings of red and green of one luminance (BT.709) under soft bars of shade."""
    y, x = np.mgrid[:320, :420].astype(float)
    rings = np.sin(np.hypot(x - 150, y - 170) / 14)[..., None] > 0
    shade = 1 + 0.25 * np.sin(x / 9)[..., None]
    colours = np.where(rings, np.array([200.0, 70.0, 60.0]), np.array([40.0, 115.5, 80.0]))
    return np.clip(np.rint(colours * shade), 0, 255).astype(np.uint8)


def eyes_mask() -> Picture:
    """White on the eyes of the astronaut, black elsewhere."""
    y, x = np.mgrid[:128, :128] / 128
    inside = ((x - 0.44) / 0.085) ** 2 + ((y - 0.21) / 0.035) ** 2 < 1
    return np.repeat(np.where(inside, 255, 0).astype(np.uint8)[..., None], 3, axis=2)


def styles_page() -> str:
    rows = [
        f"| `{name}`<br>{load_preset(name).description} | ![{SAMPLE} in the style {name}](styles/{name}.jpg) |"
        for name in names()
    ]
    return "\n".join(
        [
            "# Styles",
            "",
            "Made by `python benchmarks/styles.py`, which plans `samples/chelsea.jpg` in every preset that ships:",
            "",
            "    strokeplan plan samples/chelsea.jpg -o out.png --preset NAME",
            "",
            "`strokeplan presets show NAME` says what makes a style. [What the options do](options.md), one by one.",
            "",
            "| style | |",
            "| --- | --- |",
            *rows,
            "",
        ]
    )


def options_page() -> str:
    return "\n".join(
        [
            "# Options beyond the paper",
            "",
            "What the paper leaves to future work, one picture each, made by `python benchmarks/styles.py` from",
            "`samples/`. Each panel is a part of what its command paints.",
            "",
            *(section(option) for option in CHOICES),
        ]
    )


def section(option: Option) -> str:
    labels = [panel.label for panel in option.panels]
    lines = [f"## {option.title}", "", option.text, "", f"![{option.title}](options/{option.name}.jpg)", ""]
    lines += [f"From the left: {listed(labels)}.", "", *(f"    {panel.command}" for panel in option.panels), ""]
    return "\n".join(lines)


def listed(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} and {words[-1]}"


if __name__ == "__main__":
    main()
