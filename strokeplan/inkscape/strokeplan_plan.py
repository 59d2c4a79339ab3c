"""Inkscape extension: plan the strokes of the selected bitmaps and lay them over these as layers.

Runs under Inkscape's own Python, which has inkex and lxml but not strokeplan: strokeplan is called as a
program, and the layers of the SVG that it writes are moved into the document, to the place of the image
(x, y, width, height, preserveAspectRatio), under its transform and its clip.

Known limits: a picture that a camera holds sideways is planned upright (EXIF), whatever Inkscape shows.
Images from the network are refused.
"""

from __future__ import annotations

import base64
import binascii
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from urllib.parse import unquote, unquote_to_bytes, urlsplit
from urllib.request import url2pathname

import inkex

COMMAND_FILE = Path(__file__).with_suffix(".json")
"""Written by `strokeplan inkscape install`: how to call the strokeplan that installed this."""
HREFS = ("xlink:href", "href")
ALIGNMENT = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}


class PlanStrokes(inkex.EffectExtension):
    """The extension; its options are those of strokeplan_plan.inx."""

    def add_arguments(self, pars):
        pars.add_argument("--tab")
        pars.add_argument("--preset", default="fine")
        pars.add_argument("--strokes", type=int, default=0)
        pars.add_argument("--detail", type=float, default=0.5)
        pars.add_argument("--palette", default="")
        pars.add_argument("--seed", type=int, default=0)
        pars.add_argument("--image", choices=("hide", "keep", "remove"), default="hide")
        pars.add_argument("--background", type=inkex.Boolean, default=True)
        pars.add_argument("--trim", type=inkex.Boolean, default=True)
        pars.add_argument("--program", default="")

    def effect(self):
        images = list(self.svg.selection.get(inkex.Image))
        if not images:
            raise inkex.AbortExtension("Select a bitmap image first; a vector object has no photo to plan.")
        for image in images:
            with tempfile.TemporaryDirectory(prefix="strokeplan-") as folder:
                photo = self.photo_file(image, Path(folder))
                drawing = self.plan(photo, Path(folder) / "strokes.svg")
            self.insert(image, drawing, Path(photo).name if photo.parent != Path(folder) else image.get_id())
            if self.options.image == "hide":
                image.style["display"] = "none"
            elif self.options.image == "remove":
                image.getparent().remove(image)

    def photo_file(self, image, folder):
        """The file of an image, written into `folder` if the document holds it."""
        href = next(filter(None, map(image.get, HREFS)), "").strip()
        if not href:
            raise inkex.AbortExtension(f"Image {image.get_id()} links to no file.")
        if href[:5].lower() == "data:":
            file = folder / "photo"
            file.write_bytes(decode_data_uri(href, image.get_id()))
            return file
        # Relative to the copy that Inkscape made for extensions, or to the document itself, by version.
        documents = [name for name in (self.options.input_file, self.document_path()) if name and isinstance(name, str)]
        for name in filter(None, map(local_path, (href, image.get("sodipodi:absref")))):
            for place in [Path(document).parent / name for document in documents] or [Path(name)]:
                if place.is_file():
                    return place.resolve()
        raise inkex.AbortExtension(f"{shortened(href)}: there is no such file; save the document, or embed the image.")

    def plan(self, photo, out):
        """The drawing that strokeplan makes of a photo, as the root of its SVG."""
        options = self.options
        words = ["plan", str(photo), "-o", str(out), "--quiet", "--preset", options.preset, "--seed", str(options.seed)]
        if options.strokes > 0:
            words += ["--strokes", str(options.strokes)]
        if options.detail != 0.5:
            words += ["--detail", str(options.detail)]
        if options.palette.strip():
            words += ["--palette", options.palette.strip()]
        command = self.command()
        # Inkscape's settings for its own Python would mislead another one.
        environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONHOME", "PYTHONPATH")}
        try:
            ended = subprocess.run(
                [*command, *words],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                env=environment,
                check=False,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),  # on Windows a console would pop up
            )
        except OSError as error:
            raise inkex.AbortExtension(f"{command[0]}: cannot be run ({error.strerror}).") from None
        if ended.returncode != 0 or not out.is_file():
            lines = ended.stderr.decode("utf-8", "replace").split("\n")
            said = [line for line in lines if line.startswith("error: ")] or [line for line in lines if line.strip()]
            raise inkex.AbortExtension(
                said[-1].strip() if said else f"{command[0]} ended with code {ended.returncode}."
            )
        return inkex.load_svg(out.read_bytes()).getroot()

    def command(self):
        """How to call strokeplan: as the dialog says, as it was installed, or by its name."""
        if self.options.program.strip():
            return [self.options.program.strip()]
        if COMMAND_FILE.is_file():
            return json.loads(COMMAND_FILE.read_text(encoding="utf-8"))
        found = shutil.which("strokeplan")
        if found is None:
            raise inkex.AbortExtension(
                "strokeplan was not found; run `strokeplan inkscape install` once, or give its path in the dialog."
            )
        return [found]

    def insert(self, image, drawing, name):
        """Move the layers of a drawing into the document, right over the image."""
        width, height = (float(value) for value in drawing.get("viewBox").split()[2:])
        fitted, shown = fit(image, width, height)
        transform, anchor = inkex.Transform(image.get("transform")), image
        while not is_layer(anchor.getparent()):  # layers are layers only in layers
            anchor = anchor.getparent()
            transform = inkex.Transform(anchor.get("transform")) @ transform
        group = self.new_layer(f"{name}, {self.options.preset}")
        group.set("transform", str(transform) or None)
        for attribute in ("clip-path", "mask"):
            group.set(attribute, image.get(attribute))
        clip = self.add_clip(shown) if self.options.trim or shown != (0, 0, width, height) else None
        background = []
        for used in drawing.xpath("./svg:use[@id='background']")[:1] if self.options.background else []:
            background = [inkex.Rectangle(width=str(width), height=str(height), fill=used.get("fill"))]
            background[0].set("inkscape:label", "background")
        for part in [*background, *drawing.xpath("./svg:g[@inkscape:groupmode='layer']")]:
            part.set("id", self.new_id("strokes"))
            part.set("transform", str(fitted) or None)
            part.set("clip-path", clip)
            group.append(part)
        parent = anchor.getparent()
        parent.insert(parent.index(anchor) + 1, group)

    def new_layer(self, label):
        layer = inkex.Group()
        layer.set("inkscape:groupmode", "layer")
        layer.set("inkscape:label", label)
        layer.set("id", self.new_id("strokeplan"))
        return layer

    def add_clip(self, shown):
        """A clip of a rectangle (x, y, width, height); returns what refers to it."""
        clip = inkex.ClipPath()
        clip.set("id", self.new_id("trim"))
        rect = inkex.Rectangle()
        for key, value in zip(("x", "y", "width", "height"), shown):
            rect.set(key, f"{value:.9g}")
        clip.append(rect)
        self.svg.defs.append(clip)
        return f"url(#{clip.get('id')})"

    def new_id(self, prefix):
        """The first of prefix1, prefix2, … that is free; inkex would draw one by chance."""
        if not hasattr(self, "taken"):
            self.taken = set(self.document.xpath("//@id"))
        number = 1
        while f"{prefix}{number}" in self.taken:
            number += 1
        self.taken.add(f"{prefix}{number}")
        return f"{prefix}{number}"


def is_layer(element):
    """Whether an element is a layer, or the document itself."""
    return element.getparent() is None or element.get("inkscape:groupmode") == "layer"


def fit(image, width, height):
    """Where an image shows a picture of this size: the transform from its pixels, and the part of them that is seen.

    preserveAspectRatio as SVG 1.1, 7.8, has it.
    """
    box_width, box_height = image.width or width, image.height or height
    ratio = (image.get("preserveAspectRatio") or "").replace("defer", "").split()
    sx, sy = box_width / width, box_height / height
    align = re.fullmatch(r"x(Min|Mid|Max)Y(Min|Mid|Max)", ratio[0] if ratio else "xMidYMid")
    if align is None and ratio[0] == "none":
        return inkex.Transform(f"translate({image.left}, {image.top}) scale({sx}, {sy})"), (0, 0, width, height)
    scale = max(sx, sy) if ratio[1:] == ["slice"] else min(sx, sy)
    across, down = (ALIGNMENT[part] for part in align.groups()) if align else (0.5, 0.5)
    x, y = across * (box_width - scale * width), down * (box_height - scale * height)
    seen = [max(-x / scale, 0), max(-y / scale, 0), min(box_width / scale, width), min(box_height / scale, height)]
    return inkex.Transform(f"translate({image.left + x}, {image.top + y}) scale({scale})"), tuple(seen)


def decode_data_uri(href, name):
    """The bytes that a data: address holds."""
    header, _, body = href.partition(",")
    try:
        if header.lower().endswith(";base64"):
            return base64.b64decode(unquote_to_bytes(re.sub(r"\s+", "", body)), validate=True)
    except binascii.Error:
        raise inkex.AbortExtension(f"Image {name}: its embedded data are damaged.") from None
    return unquote_to_bytes(body)


def local_path(href):
    """The path that an address stands for, or None for an empty one. Nothing is ever fetched."""
    if not href:
        return None
    parts = urlsplit(href)
    scheme = parts.scheme.lower()
    path = url2pathname(parts.path) if scheme == "file" else unquote(href)
    known = scheme == "file" or len(scheme) < 2  # a letter is a drive
    if not known or parts.netloc not in ("", "localhost") or path.startswith(("//", "\\\\")):
        raise inkex.AbortExtension(f"{shortened(href)}: images are not fetched from elsewhere; embed the image.")
    return path


def shortened(text):
    return text if len(text) <= 80 else text[:77] + "…"


if __name__ == "__main__":
    PlanStrokes().run()
