"""A plan as one HTML page that plays it: style, script, poster and strokes are all inside, nothing is fetched.

The page's content security policy allows its own style and script by their hashes and nothing else. Names from
a plan are untrusted: they enter the markup escaped, and the page's script only ever sets them as text. Its sources
lie in page/; the script is one module, its files joined in the order of SCRIPTS.
"""

from __future__ import annotations

import base64
import html
import io
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import msgspec

from strokeplan.errors import FormatError, MissingExtraError
from strokeplan.files import atomic_write
from strokeplan.preview.encoding import encode as encode_strokes
from strokeplan.strokes import StrokePlan

if TYPE_CHECKING:
    from strokeplan.preview.plotting import Plot

SUFFIXES = (".html", ".htm")
SCRIPTS = ("decode", "geometry", "painter", "view", "stage", "gestures", "panel", "ways", "controls", "main")
POSTER_SIDE = 720
POSTER_QUALITY = 75


def check_page(path: str | Path) -> None:
    """Raise FormatError for a suffix that no page has."""
    if Path(path).suffix.lower() not in SUFFIXES:
        raise FormatError(f"{path}: unknown suffix {Path(path).suffix!r} for a page; known is .html")


def save_page(plan: StrokePlan, path: str | Path, plot: Plot | None = None) -> None:
    """Write the page of a plan to `path`, .html, whole or not at all. Raises FormatError, OutputError."""
    check_page(path)
    data = encode(plan, plot)
    with atomic_write(path) as stream:
        stream.write(data)


def encode(plan: StrokePlan, plot: Plot | None = None) -> bytes:
    """The page of a plan, or of a plot whose lines the plan is; UTF-8, the same plan gives the same bytes."""
    header, strokes = encode_strokes(plan, plot)
    style = _source("style.css")
    script = "".join(_source(f"{name}.js") for name in SCRIPTS)
    title = html.escape(header["title"])
    page = Template(_source("template.html")).substitute(
        policy=f"default-src 'none'; base-uri 'none'; form-action 'none'; img-src data: blob:; "
        f"style-src '{_hash(style)}'; script-src '{_hash(script)}'",
        title=title,
        style=style,
        script=script,
        poster=_poster(plan),
        header=_json_in_script(header),
        strokes=base64.b64encode(strokes).decode(),
    )
    return page.encode()


def _source(name: str) -> str:
    return files("strokeplan.preview").joinpath("page", name).read_text("utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(sha256(text.encode()).digest()).decode()


def _json_in_script(value: object) -> str:
    """JSON in which nothing can end or comment out the element that it stands in."""
    return msgspec.json.encode(value).decode().replace("<", r"\u003c")


def _poster(plan: StrokePlan) -> str:
    """The finished picture, small: what is seen before the strokes are painted, or without Pycairo nothing."""
    from PIL import Image

    from strokeplan.rendering import render

    shrink = min(POSTER_SIDE / max(plan.width, plan.height), 1.0)
    try:
        picture = Image.fromarray(render(plan, scale=shrink))
    except MissingExtraError:
        return ""
    stream = io.BytesIO()
    picture.save(stream, "WEBP", quality=POSTER_QUALITY, method=6)
    data = base64.b64encode(stream.getvalue()).decode()
    return f'<img id="poster" alt="" src="data:image/webp;base64,{data}">'
