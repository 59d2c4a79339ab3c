"""SVG as `export` can be asked for it: pages, groups, classes, outlines, precision; the same picture in each."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from plans import TINY, plans
from shapely import LineString, MultiLineString, MultiPoint, Polygon, unary_union
from test_svg import INKSCAPE, SVG, layer_groups, parse, parse_path, pixels, psnr, rsvg, validate, xmllint

import strokeplan
from strokeplan import ExportOptions, FormatError, InputError, Page, PresetError, StrokePlan, StrokeplanWarning
from strokeplan.curves import flatten
from strokeplan.formats import check_options, read_settings, save
from strokeplan.formats.svg import encode
from strokeplan.planner import plan as make_plan
from strokeplan.presets import load_recipe
from strokeplan.rendering import encode_png, render
from strokeplan.strokes import Layer

OWN = "{urn:strokeplan}"
A4 = ExportOptions(page=Page(297, 210, 10), clip=True)
EVERY = (
    A4,
    ExportOptions(units="mm", precision=1),
    ExportOptions(classes=True),
    ExportOptions(outline=True),
    ExportOptions(group_by="colour", classes=True, outline=True),
)


def paths(data: bytes) -> list[Any]:
    return list(parse(data).iter(f"{{{SVG}}}path"))


# The contract: what a reader finds


@given(plans(), st.booleans())
def test_an_outline_carries_its_curve_width_pressure_angle_and_pen(plan: StrokePlan, outline: bool) -> None:
    found = paths(encode(plan, ExportOptions(outline=outline)))
    tolerance = min(0.005, 5e-5 * max(plan.width, plan.height)) + 1e-8
    for i, path in enumerate(found):
        filled = outline or bool(plan.has_pressure[i])
        assert (path.get(f"{OWN}d") is not None) is filled
        knots = slice(*plan.first_knots[i : i + 2])
        if filled:
            assert np.abs(parse_path(path.get(f"{OWN}d")) - plan.stroke(i)).max() <= tolerance
            assert float(path.get(f"{OWN}width")) == pytest.approx(plan.widths[i], rel=1e-8)
        for name, column in (("pressure", plan.pressures), ("angle", plan.angles)):
            if column is None or np.isnan(column[knots]).any():
                assert path.get(OWN + name) is None
                continue
            values = np.array(path.get(OWN + name).split(), float)
            np.testing.assert_allclose(values, column[knots], atol=1.01e-4)
            assert np.all(values <= column[knots] + 1e-8)  # so that no angle reaches π


def test_root_source_and_media_are_there() -> None:
    root = parse(encode(TINY))
    assert root.get(f"{OWN}version") == "1"
    source = root.find(f".//{OWN}source")
    assert source is not None
    assert dict(source.attrib) == {"name": "tiny.png", "sha256": "00ff" * 16, "width": "20", "height": "10"}
    assert [group.get(f"{OWN}medium") for group in layer_groups(root)] == ["paint", "ink"]
    assert [path.get(f"{OWN}pen") for path in root.iter(f"{{{SVG}}}path")] == [None, None, "black"]


@pytest.mark.parametrize("options", EVERY, ids=str)
def test_document_is_valid_svg(options: ExportOptions, small_plan: StrokePlan) -> None:
    for plan in (TINY, small_plan):
        assert (xmllint(encode(plan, options)).returncode, validate(encode(plan, options)).stderr) == (0, b"")


# What the options do


def test_a_page_has_its_millimetres_and_the_canvas_in_its_middle(small_plan: StrokePlan) -> None:
    root = parse(encode(small_plan, A4))
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("297mm", "210mm", "0 0 297 210")
    x, y, width, height = (float(root.find(f".//{{{SVG}}}rect").get(key)) for key in ("x", "y", "width", "height"))
    assert (x, width) == (10, 277)
    assert height == pytest.approx(277 * small_plan.height / small_plan.width)
    assert y == pytest.approx((210 - height) / 2)
    drawn = np.concatenate([parse_path(path.get("d")) for path in root.iter(f"{{{SVG}}}path")])
    expected = small_plan.points * (277 / small_plan.width) + (x, y)
    np.testing.assert_allclose(drawn, expected, atol=0.0005001)
    widths = {float(group.get("stroke-width")) for group in layer_groups(root) if group.get("stroke-width")}
    np.testing.assert_allclose(sorted(widths), np.unique(small_plan.widths) * 277 / small_plan.width, rtol=1e-8)


def test_millimetres_without_a_page_are_those_of_the_pixels() -> None:
    root = parse(encode(TINY, ExportOptions(units="mm")))
    assert float(root.get("width", "").removesuffix("mm")) == pytest.approx(20 * 25.4 / 96)


@pytest.mark.parametrize("precision", [0, 1, 4])
def test_precision_is_the_decimals_of_coordinates(precision: int, small_plan: StrokePlan) -> None:
    shifted = replace(small_plan, points=small_plan.points + 1 / 3)
    found = paths(encode(shifted, ExportOptions(precision=precision)))
    decimals = re.findall(r"\.(\d+)", " ".join(path.get("d") for path in found))
    assert max(map(len, decimals), default=0) == precision
    chains = np.concatenate([parse_path(path.get("d")) for path in found])
    assert np.abs(chains - shifted.points).max() <= 0.5 * 10**-precision + 1e-9


def test_classes_are_shared_by_strokes_of_a_colour() -> None:
    plan = replace(TINY, colors=TINY.colors[[0, 0, 2]])
    data = encode(plan, ExportOptions(classes=True))
    assert [path.get("class") for path in paths(data)] == ["c0", "c0", "f1"]
    assert not [path for path in paths(data) if path.get("stroke") or path.get("fill")]
    assert b".c0{stroke:#cc3322}" in data
    recoloured = pixels(rsvg(data.replace(b"#cc3322", b"#00ff00"), 8))
    assert psnr(recoloured, pixels(rsvg(data, 8))) < 20


@pytest.mark.parametrize("options", EVERY[1:], ids=str)
def test_every_option_leaves_the_picture(options: ExportOptions, small_plan: StrokePlan) -> None:
    """Librsvg paints with Cairo: 52 dB and more measured; a coordinate rounded to a tenth of a mm costs most."""
    own = pixels(encode_png(render(small_plan, scale=4)))
    shown = pixels(rsvg(encode(small_plan, options), 4))[: own.shape[0], : own.shape[1]]
    assert psnr(shown, own) > (30 if options.precision else 48)


def test_a_layer_of_each_colour_is_named_after_it(small_plan: StrokePlan) -> None:
    ink = replace(small_plan, layers=tuple(replace(layer, medium="ink") for layer in small_plan.layers))
    groups = layer_groups(parse(encode(ink, ExportOptions(group_by="colour"))))
    names = [group.get(f"{{{INKSCAPE}}}label") for group in groups]
    assert len(set(names)) == len(names) == len(np.unique(small_plan.colors, axis=0))
    assert all({path.get("stroke") for path in group} == {name} for group, name in zip(groups, names, strict=True))


def test_clipping_keeps_paint_off_the_margin(small_plan: StrokePlan) -> None:
    far = replace(small_plan, points=small_plan.points * 1.5 - 20)
    for options in (A4, replace(A4, clip=False)):
        data = encode(far, options).replace(b"<title>", b'<rect width="297" height="210" fill="#fff"/><title>')
        shown = pixels(rsvg(data, 1))
        bare = bool((shown[:, : int(9 * 96 / 25.4)] == 255).all())
        assert bare is options.clip


# Outlines, against shapely's buffers


@st.composite
def bends(draw: st.DrawFn) -> NDArray[np.float64]:
    numbers = st.floats(0, 100).map(lambda value: round(value, 1))
    pieces = draw(st.integers(1, 2))
    points = draw(st.lists(st.tuples(numbers, numbers), min_size=3 * pieces + 1, max_size=3 * pieces + 1))
    return np.array(points)


@settings(max_examples=10)
@given(bends(), st.sampled_from([1.0, 6.0, 25.0]), st.booleans())
def test_an_outline_is_the_buffer_of_its_curve(chain: NDArray[np.float64], width: float, pressed: bool) -> None:
    pressures = np.ones(len(chain) // 3 + 1) if pressed else None
    plan = StrokePlan(
        width=100, height=100, points=chain, starts=np.array([0, len(chain)]), widths=np.array([width]),
        colors=np.zeros((1, 3), np.uint8), layers=(Layer("", 0, 1),), pressures=pressures,
    )  # fmt: skip
    (path,) = paths(encode(plan, ExportOptions(outline=True)))
    line = flatten(chain, 0.01)
    # Edge by edge: the buffer of a line that turns straight back is flat there.
    edges = [pair for pair in pairwise(line) if np.any(pair[0] != pair[1])]
    disc = (MultiLineString(edges) if edges else MultiPoint(line)).buffer(width / 2, 32)
    ring = flatten(parse_path(path.get("d")), 0.01)
    wound = nonzero(ring)
    assert disc.buffer(-0.15).difference(wound).area <= 0.01
    assert wound.difference(disc.buffer(0.15)).area <= 0.01


def nonzero(ring: NDArray[np.float64]) -> Any:
    """What the nonzero rule fills of a ring that crosses itself: the faces that it goes around."""
    from shapely import get_parts, node, point_on_surface, polygonize

    if np.ptp(ring, axis=0).max() < 1e-6:
        return Polygon()
    ring[-1] = ring[0]
    faces = get_parts(polygonize(get_parts(node(LineString(ring)))))
    centres = [point_on_surface(face).coords[0] for face in faces]
    return unary_union([face for face, centre in zip(faces, centres, strict=True) if winding(ring, centre) != 0])


def winding(ring: NDArray[np.float64], centre: tuple[float, float]) -> int:
    away = ring - centre
    turns = np.diff(np.arctan2(away[:, 1], away[:, 0]))
    return round(float(((turns + np.pi) % (2 * np.pi) - np.pi).sum() / (2 * np.pi)))


# What is refused


def test_an_option_that_a_format_does_not_know_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "old.json").write_bytes(b"old")
    with pytest.raises(FormatError, match=r"old.json: .json has no option group-by; it is for .svg, .svgz, .dxf"):
        save(TINY, tmp_path / "old.json", ExportOptions(group_by="colour"))
    assert (tmp_path / "old.json").read_bytes() == b"old"
    with pytest.raises(FormatError, match=r".pdf has no option precision"):
        check_options("x.pdf", ExportOptions(precision=2))
    check_options("x.svg", ExportOptions(precision=2, classes=True))


def test_options_out_of_range_are_refused() -> None:
    for precision in (-1, 7):
        with pytest.raises(InputError, match=rf"precision {precision} .*0..6"):
            ExportOptions(precision=precision)
    with pytest.raises(InputError, match="units px on a page"):
        ExportOptions(units="px", page=Page(210, 297))


# A plan made again from its file


@pytest.mark.parametrize("suffix", [".svg", ".svgz", ".json", ".json.gz"])
def test_the_settings_of_a_file_are_read_without_its_strokes(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"plan{suffix}"
    save(TINY, path)
    assert read_settings(path) == TINY.settings


def test_the_same_photo_and_an_svg_give_the_same_bytes(small_picture: NDArray[np.uint8], tmp_path: Path) -> None:
    style = strokeplan.load_preset("fine").override({"palette_size": 5, "layers.1.width": 30, "cap": "butt"})
    plan = make_plan(small_picture, style, seed=11, strokes=60)
    first = tmp_path / "first.svg"
    save(plan, first, ExportOptions(page=Page(210, 297)))
    again = make_plan(small_picture, first)
    assert encode(again) == encode(plan)
    assert again.settings == plan.settings
    assert load_recipe(first)[1:] == (11, 60, None)
    assert encode(make_plan(small_picture, first, seed=12)) != encode(plan)


def test_a_mask_that_is_missing_is_noted(small_picture: NDArray[np.uint8], tmp_path: Path) -> None:
    path, mask = tmp_path / "masked.svg", np.linspace(0, 1, 6144).reshape(64, 96)
    plan = make_plan(small_picture, "fine", mask=mask)
    save(plan, path)
    with pytest.warns(StrokeplanWarning, match="had a mask, an array"):
        make_plan(small_picture, path)
    assert encode(make_plan(small_picture, path, mask=mask)) == encode(plan)


@pytest.mark.parametrize(
    ("data", "error", "words"),
    [
        (b"", FormatError, "holds no settings"),
        (b"<svg", FormatError, "holds no settings"),
        (b"no xml", FormatError, "is not XML"),
        (b'<s xmlns="urn:strokeplan"><settings>[1]</settings></s>', FormatError, "settings cannot be read"),
        (b'<s xmlns="urn:strokeplan"><settings>{"a"</settings></s>', FormatError, "settings cannot be read"),
        (b'<s xmlns="urn:strokeplan"><settings>{}</settings></s>', PresetError, "no preset is recorded"),
        (b'<s xmlns="urn:strokeplan"><settings>{"preset":{},"seed":-1}</settings></s>', PresetError, "damaged"),
        (b'<s xmlns="urn:strokeplan"><settings>{"preset":{"x":1}}</settings></s>', PresetError, "x"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*was planned by")
def test_a_file_without_sound_settings_is_refused(
    data: bytes, error: type[Exception], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.svg"
    path.write_bytes(data)
    with pytest.raises(error, match=words) as caught:
        load_recipe(path)
    assert "bad.svg" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_entities_do_not_blow_up(tmp_path: Path) -> None:
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 12))
    bomb = f'<!DOCTYPE s [<!ENTITY e0 "haha">{entities}]><s xmlns="urn:strokeplan"><settings>&e11;</settings></s>'
    (tmp_path / "bomb.svg").write_text(bomb)
    with pytest.raises(FormatError, match="is not XML"):
        load_recipe(tmp_path / "bomb.svg")


def test_a_plan_of_another_version_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "old.json"
    preset = json.loads(json.dumps({"layers": [{"sigma": 1, "length": 9, "width": 3}]}))
    save(replace(TINY, settings={"strokeplan": "0.0.1", "seed": 4, "preset": preset}), path)
    with pytest.warns(StrokeplanWarning, match=r"planned by strokeplan 0\.0\.1; this is"):
        assert load_recipe(path).seed == 4
