"""SVG: sound XML, editable layers, the plan's own curves, and the same picture in other programs' eyes."""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import resvg_py
from conftest import need_program
from hypothesis import given
from numpy.typing import NDArray
from PIL import Image
from plans import TINY, plans
from shapely import MultiPoint, Polygon

import strokeplan
from strokeplan import StrokePlan
from strokeplan.curves import flatten
from strokeplan.formats.svg import encode
from strokeplan.layer_fields import layer_field
from strokeplan.pressure import add_pressure
from strokeplan.rendering import encode_png, render
from strokeplan.strokes import Layer, Source

GOLDEN = Path(__file__).parent / "golden" / "tiny.svg"
SVG = "http://www.w3.org/2000/svg"
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
XLINK = "http://www.w3.org/1999/xlink"
SETTINGS = "{urn:strokeplan}settings"
W3C_DTD = "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd"

RSVG_PSNR_DB = 60.0
"""librsvg paints with Cairo too: on samples/chelsea.jpg not one pixel differs (infinite)."""
RESVG_PSNR_DB = 47.5
"""resvg antialiases in its own way: 47.9 dB measured on samples/chelsea.jpg. A layer that is missing, or
a shift of one pixel, gives less than 30 dB."""
RESVG_FEW_PSNR_DB = 41.4
"""41.7 dB measured on three strokes of strong contrast, where edges are most of what differs."""
PRESSED_RSVG_PSNR_DB, PRESSED_RESVG_PSNR_DB = 49.0, 45.5
"""With full pressure on samples/chelsea.jpg at 1× and 3×: librsvg 51.5 and 49.6 dB, resvg 46.1 and 47.3 dB measured."""

AWKWARD = ["", "naïve 漢字 😀", "<&\"'>", "]]>", "a--b", "<!--strokes-->", "tab\tand\nline", "%s {0} \\u0041"]
FORBIDDEN = ["bell\x07", "\x00", "\x1b[0m", "\ufffe", "\uffff"]
"""Text with characters that XML has no place for."""


def parse(data: bytes) -> ElementTree.Element:
    return ElementTree.fromstring(data)  # noqa: S314 - our own file


def layer_groups(root: ElementTree.Element) -> list[ElementTree.Element]:
    return root.findall(f"{{{SVG}}}g")


def parse_path(d: str) -> NDArray[np.float64]:
    """The absolute (3k + 1, 2) chain of a path of one M and one relative c, as the SVG specification reads it."""
    start, pieces = re.fullmatch(r"M(.*?)c(.*?)z?", d).groups()
    numbers = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
    assert re.sub(rf"{numbers}|[\s,]", "", start + pieces) == ""
    chain = [np.array(re.findall(numbers, start), float)]
    for piece in np.array(re.findall(numbers, pieces), float).reshape(-1, 3, 2):
        chain += list(chain[-1] + piece)
    return np.array(chain)


def test_golden_file_is_written() -> None:
    assert encode(TINY) == GOLDEN.read_bytes()


def test_the_same_plan_gives_the_same_bytes(small_plan: StrokePlan) -> None:
    assert encode(small_plan) == encode(replace(small_plan))


def test_svgz_unpacks_to_the_svg(tmp_path: Path) -> None:
    TINY.save(tmp_path / "a.svg")
    TINY.save(tmp_path / "a.svgz")
    assert gzip.decompress((tmp_path / "a.svgz").read_bytes()) == (tmp_path / "a.svg").read_bytes() == encode(TINY)


# What is in it


@given(plans())
def test_curves_are_the_plan_s_to_half_a_step_of_the_grid(plan: StrokePlan) -> None:
    paths = [path.get("d", "") for path in parse(encode(plan)).iter(f"{{{SVG}}}path")]
    assert [d.endswith("z") for d in paths] == plan.has_pressure.tolist()
    plain = np.flatnonzero(~plan.has_pressure)
    chains = [parse_path(paths[i]) for i in plain]
    # 0.005 of a pixel; finer on a canvas below 100 units, whose longer side has five digits.
    tolerance = min(0.005, 5e-5 * max(plan.width, plan.height)) + 1e-8  # sums of doubles up to 1e7
    assert [len(chain) for chain in chains] == plan.counts[plain].tolist()
    for i, chain in zip(plain, chains, strict=True):
        assert np.abs(chain - plan.stroke(i)).max() <= tolerance


def test_planned_coordinates_are_exact(small_plan: StrokePlan) -> None:
    chains = [parse_path(path.get("d", "")) for path in parse(encode(small_plan)).iter(f"{{{SVG}}}path")]
    assert len(chains) == len(small_plan) > 100
    np.testing.assert_allclose(np.concatenate(chains), small_plan.points, rtol=0, atol=1e-9)


@given(plans())
def test_layers_strokes_and_settings_are_all_there(plan: StrokePlan) -> None:
    root = parse(encode(plan))
    groups = layer_groups(root)
    assert [len(group) for group in groups] == [layer.last - layer.first for layer in plan.layers]
    assert [group.get("stroke-linecap") for group in groups] == [layer.cap for layer in plan.layers]
    assert [group.get("id") for group in groups] == [f"layer{number + 1}" for number in range(len(groups))]
    assert json.loads(root.find(f".//{SETTINGS}").text) == plan.settings
    paths = list(root.iter(f"{{{SVG}}}path"))
    colors = [path.get("fill" if pressed else "stroke") for path, pressed in zip(paths, plan.has_pressure, strict=True)]
    assert [bytes.fromhex(color[1:]) for color in colors] == [bytes(color) for color in plan.colors]
    plain = ~plan.has_pressure
    widths = [float(path.get("stroke-width", group.get("stroke-width", "0"))) for group in groups for path in group]
    np.testing.assert_allclose(np.array(widths)[plain], plan.widths[plain], rtol=1e-8)


def test_one_width_stands_on_the_group_and_several_on_the_paths() -> None:
    wide, fine = layer_groups(parse(encode(TINY)))
    assert (wide.get("stroke-width"), [path.get("stroke-width") for path in wide]) == (None, ["4", "2.5"])
    assert (fine.get("stroke-width"), [path.get("stroke-width") for path in fine]) == ("0.5", [None])


def test_a_stroke_with_pressure_is_its_filled_outline() -> None:
    points, pressures = np.array([(4, 4), (8, 4), (12, 4), (16, 4)], float), np.array([0.25, 1])
    one = {"starts": np.array([0, 4]), "widths": np.array([4.0]), "colors": TINY.colors[:1], "pens": None}
    plan = replace(TINY, points=points, pressures=pressures, angles=None, layers=(Layer("", 0, 1),), **one)
    (path,) = parse(encode(plan)).iter(f"{{{SVG}}}path")
    assert (path.get("fill"), path.get("stroke"), path.get("stroke-width")) == ("#cc3322", "none", None)
    curves = parse_path(path.get("d", ""))
    np.testing.assert_allclose(curves[0], curves[-1], atol=1e-9)
    shape = Polygon(flatten(curves, 0.001))
    discs = MultiPoint([(4, 4)]).buffer(0.5, 64).union(MultiPoint([(16, 4)]).buffer(2, 64))
    assert shape.symmetric_difference(discs.convex_hull).area < 0.02 * shape.area


def test_a_stroke_of_no_pressure_keeps_its_place_and_shows_nothing() -> None:
    plan = replace(TINY, pressures=np.array([0, 0, *[np.nan] * 5]))
    paths = list(parse(encode(plan)).iter(f"{{{SVG}}}path"))
    assert [path.get("fill") for path in paths] == ["#cc3322", None, None]
    assert np.ptp(parse_path(paths[0].get("d", ""))[:, 1]) <= 0.01


def test_layers_are_layers_in_inkscape() -> None:
    groups = layer_groups(parse(encode(TINY)))
    assert [group.get(f"{{{INKSCAPE}}}groupmode") for group in groups] == ["layer", "layer"]
    assert [group.get(f"{{{INKSCAPE}}}label") for group in groups] == ["wide", "fine & last"]


def test_background_covers_the_canvas() -> None:
    root = parse(encode(replace(TINY, width=20.5)))
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("20.5", "10", "0 0 20.5 10")
    used, sheet = root.find(f"{{{SVG}}}use"), root.find(f"{{{SVG}}}defs/{{{SVG}}}rect")
    assert (used.get("id"), used.get("fill"), used.get(f"{{{XLINK}}}href")) == ("background", "#fffdf0", "#sheet")
    assert sheet.attrib == {"id": "sheet", "x": "0", "y": "0", "width": "100%", "height": "100%"}
    assert root.find(f"{{{SVG}}}rect") is None  # which plotting programs would draw


# Sound XML, whatever the names


def named(text: str) -> StrokePlan:
    """TINY with a text wherever a plan has room for one."""
    layers = tuple(replace(layer, name=text) for layer in TINY.layers)
    return replace(TINY, layers=layers, source=Source(text, "", 1, 1), settings={text: [text]})


@pytest.mark.parametrize("text", AWKWARD)
def test_text_comes_back_as_it_was(text: str) -> None:
    root = parse(encode(named(text)))
    for name in (f"{{{INKSCAPE}}}label", "{urn:strokeplan}name"):
        assert {group.get(name) for group in layer_groups(root)} == {text}
    assert root.find(f"{{{SVG}}}title").text == (text or "strokeplan")
    assert json.loads(root.find(f".//{SETTINGS}").text) == {text: [text]}


@pytest.mark.parametrize("text", FORBIDDEN)
def test_characters_that_xml_cannot_hold_are_replaced_in_names_and_escaped_in_settings(text: str) -> None:
    root = parse(encode(named(text)))
    shown = re.sub("[\x00-\x1f\ufffe\uffff]", "\ufffd", text)
    assert {group.get(f"{{{INKSCAPE}}}label") for group in layer_groups(root)} == {shown}
    assert root.find(f"{{{SVG}}}title").text == shown
    assert json.loads(root.find(f".//{SETTINGS}").text) == {text: [text]}


def xmllint(data: bytes, *options: str) -> subprocess.CompletedProcess[bytes]:
    command = [need_program("xmllint"), "--noout", "--nonet", *options, "-"]
    return subprocess.run(command, input=data, capture_output=True, check=False)


@pytest.mark.parametrize("text", ["plain", *AWKWARD, *FORBIDDEN], ids=ascii)
def test_document_is_well_formed(text: str) -> None:
    run = xmllint(encode(named(text)))
    assert (run.returncode, run.stderr) == (0, b"")


def validate(data: bytes) -> subprocess.CompletedProcess[bytes]:
    """xmllint against the W3C's DTD of SVG 1.1, without what a DTD cannot know: foreign attributes and elements."""
    root = parse(data)
    for element in root.iter():
        for name in [name for name in element.attrib if name.startswith((f"{{{INKSCAPE}}}", "{urn:strokeplan}"))]:
            del element.attrib[name]
    for metadata in root.iter(f"{{{SVG}}}metadata"):
        metadata.clear()
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("xlink", XLINK)
    run = xmllint(ElementTree.tostring(root), "--dtdvalid", W3C_DTD)
    if b"Could not parse DTD" in run.stderr:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("the W3C's DTDs (w3c-sgml-lib) are not installed")
    return run


def test_document_is_valid_svg(small_plan: StrokePlan) -> None:
    for plan in (TINY, small_plan):
        run = validate(encode(plan))
        assert (run.returncode, run.stderr) == (0, b"")


def test_validation_finds_a_wrong_attribute() -> None:
    assert b"No declaration for attribute colour" in validate(encode(TINY).replace(b" stroke=", b" colour=")).stderr


# The picture, in other programs' eyes


@pytest.fixture(scope="module")
def photo_plan(sample_photo: Path) -> StrokePlan:
    return strokeplan.plan(sample_photo, "paper")


def rsvg(data: bytes, scale: int = 1) -> bytes:
    command = [need_program("rsvg-convert"), "--unlimited", "--zoom", str(scale)]
    return subprocess.run(command, input=data, capture_output=True, check=True).stdout


def resvg(data: bytes, scale: int = 1) -> bytes:
    return resvg_py.svg_to_bytes(svg_string=data.decode(), skip_system_fonts=True, zoom=scale)


PROGRAMS = {"rsvg": rsvg, "resvg": resvg}


def pixels(png: bytes) -> NDArray[np.float64]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)


def psnr(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    error = np.mean((a - b) ** 2)
    return float("inf") if error == 0 else float(10 * np.log10(255**2 / error))


def without_layer(data: bytes, number: int) -> bytes:
    cut = re.sub(rb'<g [^>]*id="layer%d".*?</g>' % number, b"", data, flags=re.DOTALL)
    assert len(cut) < len(data)
    return cut


RENDERERS = pytest.mark.parametrize(("paint", "bound"), [(rsvg, RSVG_PSNR_DB), (resvg, RESVG_PSNR_DB)])


@RENDERERS
def test_picture_is_the_one_that_render_paints(
    paint: Callable[[bytes], bytes], bound: float, photo_plan: StrokePlan
) -> None:
    assert psnr(pixels(paint(encode(photo_plan))), pixels(encode_png(render(photo_plan)))) > bound


@pytest.mark.parametrize(("paint", "bound"), [(rsvg, RSVG_PSNR_DB), (resvg, RESVG_FEW_PSNR_DB)])
def test_widths_and_caps_are_those_that_render_paints(paint: Callable[[bytes], bytes], bound: float) -> None:
    plan = replace(TINY, width=400, height=200, points=20 * TINY.points, widths=20 * TINY.widths, pressures=None)
    own = pixels(encode_png(render(plan)))
    assert psnr(pixels(paint(encode(plan))), own) > bound
    assert psnr(pixels(paint(encode(plan).replace(b'linecap="butt"', b'linecap="round"'))), own) < bound - 5


@pytest.fixture(scope="module")
def pressed_plan(sample_photo: Path, photo_plan: StrokePlan) -> StrokePlan:
    photo, preset = strokeplan.load_photo(sample_photo), strokeplan.load_preset("paper")
    fields = (layer_field(photo, preset, number + 1) for number in range(len(photo_plan.layers)))
    return add_pressure(photo_plan, fields, 1)


@pytest.mark.parametrize("scale", [1, 3])
@pytest.mark.parametrize(("program", "bound"), [("rsvg", PRESSED_RSVG_PSNR_DB), ("resvg", PRESSED_RESVG_PSNR_DB)])
def test_strokes_with_pressure_are_those_that_render_paints(
    program: str, bound: float, scale: int, pressed_plan: StrokePlan, photo_plan: StrokePlan
) -> None:
    own = pixels(encode_png(render(pressed_plan, scale=scale)))
    shown = pixels(PROGRAMS[program](encode(pressed_plan), scale))
    assert psnr(shown, own) > bound
    assert psnr(shown, pixels(encode_png(render(photo_plan, scale=scale)))) < bound - 20


@RENDERERS
def test_a_picture_without_a_layer_is_another(
    paint: Callable[[bytes], bytes], bound: float, photo_plan: StrokePlan
) -> None:
    own = pixels(encode_png(render(photo_plan)))
    for number in range(1, len(photo_plan.layers) + 1):
        assert psnr(pixels(paint(without_layer(encode(photo_plan), number))), own) < bound - 15


@RENDERERS
def test_a_picture_shifted_by_a_pixel_is_another(
    paint: Callable[[bytes], bytes], bound: float, photo_plan: StrokePlan
) -> None:
    data = encode(photo_plan)
    shifted = data.replace(b'viewBox="0 0 ', b'viewBox="1 0 ')
    assert shifted != data
    assert psnr(pixels(paint(shifted)), pixels(encode_png(render(photo_plan)))) < bound - 15
