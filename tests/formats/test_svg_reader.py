"""Reading SVG: ours comes back as it was, edited or not; others' look as other programs show them; none does harm."""

from __future__ import annotations

import gzip
import io
import itertools
import json
import re
import subprocess
import warnings
from dataclasses import replace
from itertools import pairwise
from math import ceil, log10
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import svgelements
from conftest import need_program
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from plans import TINY, plans

import strokeplan
from strokeplan import ExportOptions, StrokePlan
from strokeplan.errors import FormatError, StrokeplanWarning
from strokeplan.formats import svg_reader, svg_xml
from strokeplan.formats.svg import _NOT_XML, encode
from strokeplan.formats.svg_path import is_simple, simple_chains, subpaths
from strokeplan.formats.svg_reader import decode
from strokeplan.rendering import render
from strokeplan.strokes import Layer, Source, rgb_to_hex

GOLDEN = Path(__file__).parent / "golden"
FOREIGN_PSNR_DB = 45.0
"""golden/foreign.svg as librsvg paints it: 45.7 dB measured (opacity rounds to 8 bits, caps are a layer's)."""
EVERY = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" xmlns:s="urn:strokeplan"'
INKSCAPE = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
LINE = 'd="M1 1L4 1" fill="none" stroke="red"'


def svg(inside: str, root: str = 'viewBox="0 0 100 50"') -> bytes:
    return f"<svg {EVERY} {INKSCAPE} {root}>{inside}</svg>".encode()


def fault(data: bytes) -> str:
    """The message for a document that is refused: one line."""
    with pytest.raises(FormatError) as caught:
        decode(data, "a.svg")
    message = str(caught.value)
    assert message.startswith("a.svg: ")
    assert "\n" not in message
    return message.removeprefix("a.svg: ")


def quiet(data: bytes) -> StrokePlan:
    """The plan of a document of which not all is strokes."""
    with pytest.warns(StrokeplanWarning):
        return decode(data)


def names(plan: StrokePlan) -> list[tuple[str, int]]:
    return [(layer.name, layer.last - layer.first) for layer in plan.layers]


# Our own files


def document(plan: StrokePlan) -> bytes:
    """A plan as SVG by the letter of the contract, with all that it may carry; absolute coordinates, exact."""

    def path(i: int) -> str:
        def data(chain: NDArray[np.float64]) -> str:
            first, *rest = (f"{x!r} {y!r}" for x, y in chain.tolist())
            return f"M{first}C{' '.join(rest)}"

        first, last = plan.first_knots[i : i + 2]
        own = "" if plan.pens is None or plan.pens[i] is None else f" s:pen={attribute(plan.pens[i])}"
        if plan.angles is not None and not np.isnan(plan.angles[first]):
            own += f' s:angle="{" ".join(map(repr, plan.angles[first:last].tolist()))}"'
        color, width, chain = rgb_to_hex(tuple(plan.colors[i].tolist())), float(plan.widths[i]), plan.stroke(i)
        if not plan.has_pressure[i] and "s:angle" not in own:
            return f'<path stroke="{color}" stroke-width="{width!r}"{own} d="{data(chain)}"/>'
        if plan.has_pressure[i]:
            own += f' s:pressure="{" ".join(map(repr, plan.pressures[first:last].tolist()))}"'
        return f'<path fill="{color}" s:width="{width!r}"{own} s:d="{data(chain)}" d="{data(chain)}z"/>'

    settings = _NOT_XML.sub(lambda bad: f"\\u{ord(bad[0]):04x}", json.dumps(plan.settings, ensure_ascii=False))
    settings = settings.replace("&", "&amp;").replace("<", "&lt;").replace("\r", "&#13;")
    source = plan.source
    inside = f"<metadata><s:settings>{settings}</s:settings>"
    if source is not None:
        size = f'width="{source.width}" height="{source.height}"'
        inside += f"<s:source name={attribute(source.name)} sha256={attribute(source.sha256)} {size}/>"
    inside += f'</metadata><rect id="background" width="100%" height="100%" fill="{rgb_to_hex(plan.background)}"/>'
    for layer in plan.layers:
        head = f'inkscape:groupmode="layer" inkscape:label={attribute(layer.name)} s:medium="{layer.medium}"'
        strokes = "".join(path(i) for i in range(layer.first, layer.last))
        inside += f'<g {head} fill="none" stroke-linecap="{layer.cap}">{strokes}</g>'
    size = f'width="{plan.width!r}" height="{plan.height!r}"'
    return svg(inside, f'{size} viewBox="0 0 {plan.width!r} {plan.height!r}"')


def attribute(text: str) -> str:
    return quoteattr(clean(text), {"\r": "&#13;", "\n": "&#10;", "\t": "&#9;"})


def clean(text: str) -> str:
    return _NOT_XML.sub("\ufffd", text)


def cleaned(plan: StrokePlan) -> StrokePlan:
    """The plan without what XML has no place for."""
    source = plan.source
    return replace(
        plan,
        layers=tuple(replace(layer, name=clean(layer.name)) for layer in plan.layers),
        source=source and replace(source, name=clean(source.name), sha256=clean(source.sha256)),
        pens=plan.pens and tuple(pen if pen is None else clean(pen) for pen in plan.pens),
    )


def assert_read_back(again: StrokePlan, plan: StrokePlan, step: float, digits: float = 1e-12) -> None:
    """Fail unless a plan is another, positions to half of `step`, other numbers to `digits`."""
    assert np.abs(again.points - plan.points).max(initial=0) <= 0.5001 * step + 1e-7
    for name in ("width", "height", "widths"):
        np.testing.assert_allclose(getattr(again, name), getattr(plan, name), rtol=digits)
    for name in ("starts", "colors", "pressures", "angles"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plan, name), err_msg=name)
    for name in ("layers", "background", "settings", "source", "pens"):
        assert getattr(again, name) == getattr(plan, name), name


@given(plans())
def test_all_that_our_files_carry_is_read_back(plan: StrokePlan) -> None:
    step = 10.0 ** (ceil(log10(max(plan.width, plan.height))) - 9)
    assert_read_back(decode(document(plan)), cleaned(plan), step)


def test_reading_back_is_compared_in_every_field() -> None:
    other = {"points": TINY.points + 0.1, "widths": TINY.widths * 2, "background": (0, 0, 0), "pens": None}
    for name, value in other.items():
        with pytest.raises(AssertionError):
            assert_read_back(replace(TINY, **{name: value}), TINY, 0.01)


def test_a_planned_picture_comes_back_to_the_last_bit(small_plan: StrokePlan, tmp_path: Path) -> None:
    for name in ("a.svg", "a.svgz"):
        small_plan.save(tmp_path / name)
        again = strokeplan.load(tmp_path / name)
        np.testing.assert_array_equal(again.points, small_plan.points)
        np.testing.assert_array_equal(again.widths, small_plan.widths)
        assert (again.layers, again.settings) == (small_plan.layers, small_plan.settings)
        assert again._repr_svg_().partition("<metadata>")[2] == small_plan._repr_svg_().partition("<metadata>")[2]


MOVES = {
    "moved": (1, 0, 0, 1, 3, -1.5),
    "turned": (0.8, 0.6, -0.6, 0.8, 2, 1),
    "scaled": (1.5, 0, 0, 1.5, -2, 1),
    "stretched": (1.5, 0, 0, 0.8, 0, 0),
    "mirrored": (-1, 0, 0, 1, 20, 0),
    "skewed after a turn": (0.9, 0.6, -0.2, 0.8, 2, 1),
}


@pytest.mark.parametrize("move", MOVES)
def test_a_brush_stroke_follows_its_outline(move: str) -> None:
    """A drawing program rewrites `d` and leaves what it does not know."""
    before = encode(TINY).decode()
    at = before.index(' d="', before.index("<path fill=")) + 4
    (shown,) = subpaths(before[at : before.index('"', at)])
    a, b, c, d, e, f = MOVES[move]
    x, y = np.array(shown).reshape(-1, 2).T
    points = np.stack([a * x + c * y + e, b * x + d * y + f], axis=1).round(3)
    data = f"M{points[0][0]},{points[0][1]} C" + " ".join(f"{x},{y}" for x, y in points[1:].tolist())
    after = decode((before[:at] + data + before[before.index('"', at) :]).encode())
    x, y = TINY.stroke(2).T
    np.testing.assert_allclose(after.stroke(2), np.stack([a * x + c * y + e, b * x + d * y + f], axis=1), atol=0.01)
    np.testing.assert_allclose(after.widths[2], TINY.widths[2] * abs(a * d - b * c) ** 0.5, rtol=0.003)
    np.testing.assert_array_equal(after.points[:11], TINY.points[:11])


def test_a_brush_stroke_whose_outline_is_another_is_kept_as_that() -> None:
    text = encode(TINY).decode()
    at = text.index(' d="', text.index("<path fill=")) + 4
    data = text[at : text.index('"', at)]
    dragged = data.replace("c.553-.232 1.131-.401 1.714-.539 .951", "c.553-.232 1.131-.401 1.714-.439 .951")
    for other in ("M0 0L20 0L0 10z", data + data, dragged):
        with pytest.warns(StrokeplanWarning, match=r"brush stroke of another shape kept as its outline \(1\)"):
            plan = decode(text.replace(data, other).encode())
        assert plan.pressures is None
        assert plan.stroke(2)[0].tolist() == plan.stroke(2)[-1].tolist()


EDITS = (
    "select-by-id:p0;delete;select-clear;"
    "select-by-id:p1;transform-translate:10,5;select-clear;"
    "select-by-id:p2;object-set-property:stroke,#ff00ff;selection-group;select-clear;"
    "select-by-id:p3;transform-scale:30;select-clear;"
    "select-by-id:brush0;transform-rotate:90;select-clear;"
    "select-by-id:brush1;transform-translate:-7,3;select-clear;"
    "select-by-id:layer1;object-set-attribute:inkscape:label,renamed;select-clear"
)


@pytest.mark.slow
@pytest.mark.parametrize("options", [ExportOptions(), ExportOptions(units="mm"), ExportOptions(classes=True)], ids=str)
@pytest.mark.parametrize("plain", [[], ["--export-plain-svg"]], ids=["inkscape", "plain"])
def test_inkscape_s_edits_are_read(
    plain: list[str], options: ExportOptions, small_plan: StrokePlan, tmp_path: Path
) -> None:
    """For real: a stroke deleted, one moved, one recoloured and grouped, one scaled, brush strokes turned and moved."""
    first = small_plan.layers[0].last
    pressures = np.where(np.arange(small_plan.first_knots[-1]) < small_plan.first_knots[first], np.nan, 0.7)
    plan = replace(small_plan, pressures=pressures)
    running = itertools.count()
    data = re.sub(rb"\n<path ", lambda _: b'\n<path id="p%d" ' % next(running), encode(plan, options))
    actions = EDITS.replace("brush0", f"p{first}").replace("brush1", f"p{first + 1}")
    (tmp_path / "a.svg").write_bytes(data)
    before = strokeplan.load(tmp_path / "a.svg")
    save = ["--export-type=svg", *plain, f"--export-filename={tmp_path / 'b.svg'}", f"--actions={actions}"]
    subprocess.run([need_program("inkscape"), tmp_path / "a.svg", *save], check=True, capture_output=True, timeout=100)
    after = strokeplan.load(tmp_path / "b.svg")
    unit = 25.4 / 96 if options.units == "mm" else 1.0
    assert len(after) == len(before) - 1
    assert [layer.last - layer.first for layer in after.layers][1:] == [
        layer.last - layer.first for layer in before.layers
    ][1:]
    assert [layer.name for layer in after.layers][1:] == [layer.name for layer in before.layers][1:]
    assert after.layers[0].name == (before.layers[0].name if plain else "renamed")
    assert (after.settings, after.source, after.background) == (before.settings, before.source, before.background)
    slack = 2e-4 * max(before.width, before.height)
    np.testing.assert_allclose(after.stroke(0), before.stroke(1) + np.array([10 * unit, 5 * unit]), atol=slack)
    assert [255, 0, 255] in after.colors[: first - 1].tolist()
    assert after.widths[: first - 1].max() > before.widths[:first].max()
    turned, old = after.stroke(first - 1), before.stroke(first)
    np.testing.assert_allclose(np.ptp(turned, axis=0), np.ptp(old, axis=0)[::-1], atol=slack)
    shift = np.array([-7 * unit, 3 * unit])
    np.testing.assert_allclose(after.stroke(first), before.stroke(first + 1) + shift, atol=slack)
    np.testing.assert_allclose(after.points[after.starts[first + 1] :], before.points[before.starts[first + 2] :],
                               atol=slack)  # fmt: skip
    np.testing.assert_array_equal(after.has_pressure[first - 1 :], True)


# Everybody else's


def rsvg(path: Path, width: int) -> NDArray[np.float64]:
    command = [need_program("rsvg-convert"), "-w", str(width), path]
    png = subprocess.run(command, check=True, capture_output=True, timeout=60).stdout
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), np.float64)


def test_a_foreign_file_looks_as_librsvg_shows_it() -> None:
    plan = strokeplan.load(GOLDEN / "foreign.svg")
    shown = rsvg(GOLDEN / "foreign.svg", 840)

    def psnr(plan: StrokePlan) -> float:
        return 10 * np.log10(255**2 / np.mean((render(plan, width=840) - shown) ** 2))

    assert psnr(plan) > FOREIGN_PSNR_DB
    assert psnr(replace(plan, points=plan.points + 0.5)) < FOREIGN_PSNR_DB - 10
    assert plan.settings == {"page_mm": [210, 148.5]}
    assert names(plan) == [("shapes", 8), ("deep", 7), ("3", 1), ("4", 1)]


def length(chains: list[list[float]]) -> float:
    total = 0.0
    t = np.linspace(0, 1, 200)[:, None]
    for chain in chains:
        points = np.array(chain).reshape(-1, 2)
        for i in range(0, len(points) - 1, 3):
            p, q, r, s = points[i : i + 4]
            curve = (1 - t) ** 3 * p + 3 * (1 - t) ** 2 * t * q + 3 * (1 - t) * t**2 * r + t**3 * s
            total += float(np.hypot(*np.diff(curve, axis=0).T).sum())
    return total


def _commands() -> st.SearchStrategy[str]:
    number = st.integers(-200, 200).map(lambda v: v / 4)
    some = {"l": 2, "h": 1, "v": 1, "c": 6, "s": 4, "q": 4, "t": 2, "m": 2}
    plain = st.sampled_from([*some, *map(str.upper, some)]).flatmap(
        lambda c: st.lists(number, min_size=some[c.lower()], max_size=some[c.lower()]).map(
            lambda v: c + " ".join(map(str, v))
        )
    )
    arc = st.builds(
        lambda c, r, q, turn, flags, x, y: f"{c}{r} {q} {turn} {flags} {x} {y}",
        *(st.sampled_from("aA"), st.integers(1, 90), st.integers(1, 90), st.integers(-90, 90)),
        *(st.sampled_from(["0 0", "0 1", "1,0", "1 1"]), number, number),
    )
    return st.lists(plain | arc | st.just("z"), min_size=1, max_size=8).map(lambda parts: "M3 4" + "".join(parts))


@given(_commands())
def test_paths_are_as_long_as_svgelements_finds_them(data: str) -> None:
    # After a curve of the other kind SVG has a smooth one begin at its point; svgelements mirrors even there.
    assume(not re.search("[csCS][^a-zA-Z]*[tT]|[qtQT][^a-zA-Z]*[sS]", data))
    theirs = svgelements.Path(data)
    assert length(subpaths(data)) == pytest.approx(theirs.length(error=1e-5), rel=2e-3, abs=1e-3)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("M0 0L3 6", [[0, 0, 1, 2, 2, 4, 3, 6]]),
        ("m1,1h3v-3", [[1, 1, 2, 1, 3, 1, 4, 1, 4, 0, 4, -1, 4, -2]]),
        ("M0 0Q3 3 6 0", [[0, 0, 2, 2, 4, 2, 6, 0]]),
        ("M1-2.5.5.5", [[1, -2.5, 5 / 6, -1.5, 2 / 3, -0.5, 0.5, 0.5]]),
        ("M0 0c1 1 2 1 3 0z", [[0, 0, 1, 1, 2, 1, 3, 0, 2, 0, 1, 0, 0, 0]]),
        ("M0 0c1 1 2 1 3 0c1 1 -3 1 -3 0z", [[0, 0, 1, 1, 2, 1, 3, 0, 4, 1, 0, 1, 0, 0]]),
        ("M5 5z", [[5, 5] * 4]),
        ("M5 5M6 6", []),
        ("", []),
        ("none", []),
    ],
)
def test_path_data_become_chains(data: str, expected: list[list[float]]) -> None:
    found = subpaths(data)
    assert [len(chain) for chain in found] == [len(chain) for chain in expected]
    for chain, wanted in zip(found, expected, strict=True):
        assert chain == pytest.approx(wanted)


@given(st.lists(st.lists(st.tuples(*[st.decimals(-999, 999, places=2).map(str)] * 6), min_size=1, max_size=4)))
def test_simple_paths_read_together_are_those_read_one_by_one(strokes: list[list[tuple[str, ...]]]) -> None:
    data = ["M1.5,-2c" + " ".join(" ".join(piece) for piece in stroke).replace(" -", "-") for stroke in strokes]
    assert all(map(is_simple, data))
    points, counts = simple_chains(data)
    assert [2 * count for count in counts.tolist()] == [len(subpaths(each)[0]) for each in data]
    assert points.ravel().tolist() == [value for each in data for value in subpaths(each)[0]]


@pytest.mark.parametrize(
    "data",
    [
        "M1 2c1 2 3 4 5", "M1 2c1e3 2 3 4 5 6", "M1 2C1 2 3 4 5 6", "M1 2c.1.2 3 4 5 6", "M1 2c",
        "M1 2c1 2 3 4 5 6z", "m1 2c1 2 3 4 5 6", "M1 2c1 2 3 4 5 nan",
    ],
)  # fmt: skip
def test_what_is_not_simple_is_read_by_the_letter(data: str) -> None:
    assert not is_simple(data)


def test_each_subpath_is_a_stroke_and_transforms_reach_points_and_widths() -> None:
    plan = decode(svg('<g transform="translate(10 0) scale(2)"><path fill="none" stroke="red" d="M0 0h3M5 5v3"/></g>'))
    assert plan.stroke(0).tolist() == [[10, 0], [12, 0], [14, 0], [16, 0]]
    assert plan.stroke(1)[-1].tolist() == [20, 16]
    assert plan.widths.tolist() == [2, 2]


def test_a_stroke_scaled_differently_in_x_and_y_gets_the_mean_width() -> None:
    assert decode(svg(f'<path {LINE} transform="scale(8 2)"/>')).widths.tolist() == [4]
    fixed = f'<path {LINE} transform="scale(8 2)" vector-effect="non-scaling-stroke"/>'
    assert decode(svg(fixed)).widths.tolist() == [1]


@pytest.mark.parametrize(
    "inside",
    [
        f'<g display="none"><path {LINE}/></g>',
        f'<path {LINE} visibility="hidden"/>',
        f'<path {LINE} style="opacity:0"/>',
        f'<path {LINE} stroke-opacity="0"/>',
        f'<path {LINE} stroke-width="0"/>',
        f"<defs><path {LINE}/></defs>",
        f"<symbol><path {LINE}/></symbol>",
        f"<clipPath><path {LINE}/></clipPath>",
        f"<mask><path {LINE}/></mask>",
        f"<pattern><path {LINE}/></pattern>",
        f"<marker><path {LINE}/></marker>",
        '<path d="M0 0h1" fill="none"/>',
        "<script>alert(1)</script>",
        f"<style>path {{ display: none }}</style><path {LINE}/>",
        f'<x xmlns="urn:other"><path {LINE}/></x>',
    ],
)
def test_what_is_not_seen_is_no_stroke(inside: str) -> None:
    assert len(decode(svg(f"{inside}<path {LINE}/>".replace("<path", "<path", 1)))) <= 1
    assert len(decode(svg(inside))) == 0


@pytest.mark.parametrize(
    ("style", "color"),
    [
        ("stroke:#0f0", (0, 255, 0)),
        ("stroke:rgb(10%,20%,100%)", (26, 51, 255)),
        ("stroke:RGB(1 2 3)", (1, 2, 3)),
        ("stroke:hsl(240,100%,50%)", (0, 0, 255)),
        ("stroke:currentColor;color:teal", (0, 128, 128)),
        ("stroke:#ff000080", (255, 127, 127)),
        ("stroke:rgba(0,0,0,.2)", (204, 204, 204)),
        ("stroke:black;opacity:50%", (128, 128, 128)),
        ("stroke:url(#none) navy", (0, 0, 128)),
    ],
)
def test_colours_are_read_and_opacity_is_blended_over_the_background(style: str, color: tuple[int, ...]) -> None:
    plan = decode(svg(f'<path d="M0 0h1" fill="none" style="{style}"/>'))
    assert tuple(plan.colors[0].tolist()) == color


def test_stylesheets_take_precedence_as_css_says() -> None:
    css = ".a{stroke:red} .b{stroke:lime} path{stroke:blue} #i{stroke:navy} g .c{stroke:teal}"
    css += ".d{stroke:#010203!important}"
    inside = "".join(
        f'<path d="M0 0h1" fill="none" stroke="#999" {more}/>'
        for more in ("", 'class="b a"', 'class="a" id="i"', 'class="c"', 'class="a" style="stroke:#123456"',
                     'class="d" style="stroke:#123456"')
    )  # fmt: skip
    css += "@media print{.a{stroke:yellow}} /* .a{stroke:yellow} */"
    plan = decode(svg(f"<style>{css}</style><g>{inside}</g>"))
    found = [rgb_to_hex(tuple(color)) for color in plan.colors.tolist()]
    assert found == ["#0000ff", "#00ff00", "#000080", "#008080", "#123456", "#010203"]


def test_layers_are_inkscape_s_else_outermost_groups_else_one() -> None:
    path = f"<path {LINE}/>"
    assert names(decode(svg(path * 2))) == [("1", 2)]
    assert names(decode(svg(f'<g id="pens">{path}<g>{path}</g></g><g>{path}</g><g/>'))) == [("pens", 2), ("2", 1)]
    layer = 'inkscape:groupmode="layer" inkscape:label'
    nested = f'<g><g {layer}="a"><g {layer}="a1">{path}</g><g id="no">{path}</g></g><g {layer}="empty"/></g>'
    assert names(decode(svg(nested))) == [("a1", 1), ("a", 1), ("empty", 0)]


def test_painting_order_wins_over_grouping() -> None:
    path = '<path d="M{0} 0h1" fill="none" stroke="red"/>'.format
    layer = '<g inkscape:groupmode="layer" inkscape:label="a">'
    inner = f'{layer}{path(1)}<g inkscape:groupmode="layer" inkscape:label="b">{path(2)}</g>{path(3)}</g>{path(4)}'
    plan = decode(svg(inner))
    assert plan.points[::4, 0].tolist() == [1, 2, 3, 4]
    assert names(plan) == [("a", 1), ("b", 1), ("a", 1), ("4", 1)]


@pytest.mark.parametrize(
    ("root", "size", "page", "first"),
    [
        ('viewBox="0 0 100 50"', (100, 50), None, (1, 1)),
        ('width="200" height="100" viewBox="0 0 100 50"', (100, 50), None, (1, 1)),
        ('width="4in" height="2in" viewBox="0 0 100 50"', (100, 50), [101.6, 50.8], (1, 1)),
        ('width="10cm" height="50mm" viewBox="-5 -6 100 50"', (100, 50), [100, 50], (6, 7)),
        ('width="100%" height="100%" viewBox="0 0 100 50"', (100, 50), None, (1, 1)),
        ('width="100" height="100" viewBox="0 0 100 50"', (100, 100), None, (1, 26)),
        ('width="100" height="100" viewBox="0 0 100 50" preserveAspectRatio="none"', (100, 100), None, (1, 2)),
        ('width="25.4mm" height="1in"', (96, 96), [25.4, 25.4], (1, 1)),
        ("", (4.5, 1.5), None, (1, 1)),
    ],
)
def test_canvas_and_page(
    root: str, size: tuple[float, float], page: list[float] | None, first: tuple[int, int]
) -> None:
    plan = decode(svg(f"<path {LINE}/>", root))
    assert (plan.width, plan.height) == pytest.approx(size)
    assert plan.settings.get("page_mm") == (page and pytest.approx(page))
    assert tuple(plan.points[0]) == pytest.approx(first)


def test_uses_and_symbols_are_drawn_where_they_are_used() -> None:
    inside = (
        f'<defs><path id="a" {LINE}/></defs><symbol id="b" viewBox="0 0 10 10"><path {LINE}/></symbol>'
        '<use href="#a" x="10" y="5"/><use xlink:href="#a"/><use href="#b" x="50" width="20" height="20"/>'
    )
    plan = decode(svg(inside))
    assert plan.points[::4].tolist() == [[11, 6], [1, 1], [52, 2]]
    assert plan.widths.tolist() == [1, 1, 2]


def test_a_leading_rectangle_over_all_is_the_background() -> None:
    plan = decode(svg('<rect x="-1" width="102" height="50" fill="navy"/>' + f"<path {LINE}/>"))
    assert (plan.background, len(plan)) == ((0, 0, 128), 1)
    later = quiet(svg(f'<path {LINE}/><rect width="100" height="50" fill="navy"/>'))
    assert (later.background, len(later)) == ((255, 255, 255), 2)


def test_what_is_no_stroke_is_counted_in_one_warning() -> None:
    inside = (
        '<text>a</text><text>b</text><image/><path d="M0 0h9v9z"/><circle r="3" stroke="red"/>'
        '<linearGradient id="g"><stop stop-color="#f00"/><stop stop-color="#00f"/></linearGradient>'
        '<path d="M0 0h9" fill="none" stroke="url(#g)" stroke-dasharray="1 2"/>'
    )
    with pytest.warns(StrokeplanWarning) as caught:
        plan = decode(svg(inside), "a.svg")
    assert [str(warning.message) for warning in caught] == [
        "a.svg: not all of it is strokes: text left out (2), image left out (1), filled shape kept as its outline (1), "
        "fill left out (1), gradient made one colour (1), dashed line drawn through (1)"
    ]
    assert plan.widths.tolist() == [0.1, 1, 1]
    assert plan.colors[2].tolist() == [128, 0, 128]


# What does harm elsewhere

DEEP = "<g>" * 100_000 + "</g>" * 100_000
LAUGHS = "<!DOCTYPE x [<!ENTITY a 'ha'>" + "".join(f"<!ENTITY {b} '&{a};&{a};'>" for a, b in pairwise("abcdef")) + "]>"
EXPONENTIAL = f'<g id="a0"><path {LINE}/></g>' + "".join(
    f'<g id="a{i + 1}">' + f'<use href="#a{i}"/>' * 9 + "</g>" for i in range(9)
)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (b" \n", "is empty"),
        (b"hello", "is no sound XML: syntax error, line 1, column 1"),
        (b"<html/>", "is no SVG: its root element is <html>"),
        (svg("")[:-3], "is no sound XML: unclosed token, line 1"),
        (svg(DEEP), "elements are nested more than 200 deep"),
        (svg("\n<g>\n<a></g>"), "is no sound XML: mismatched tag, line 3"),
        (LAUGHS.encode() + svg("&f;"), "the entity 'b' holds markup or other entities"),
        (b"<!DOCTYPE x [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>" + svg("&a;"), "stands for another file"),
        (b"<!DOCTYPE x [<!ENTITY % a SYSTEM 'http://localhost/'> %a;]>" + svg(""), "stands for another file"),
        (f"<!DOCTYPE x [<!ENTITY a '{'a' * 9999}'>]>".encode() + svg("&a;" * 9999), "would come to more than"),
        (svg('<g id="a"><use href="#a"/></g>'), "line 1, <use>: uses '#a', in which it stands itself"),
        (svg(EXPONENTIAL), "uses show more than 1,000 elements"),
        (svg('<path id="p" d="MNaN 0h1" stroke="red"/>'), "line 1, <path id='p'>: 'M' in path data has 0 numbers"),
        (svg('<path d="M1e999 0h1"/>'), "a coordinate is not within"),
        (svg('<path d="M1e30 0h1"/>'), "a coordinate is not within"),
        (svg('<path d="M0 0h1" transform="scale(1e300)scale(1e300)"/>'), "a coordinate is not within"),
        (svg('<path d="M0 0A1e999 1 0 0 1 2 2"/>'), "an arc in path data has a number that is too large"),
        (svg('<path d="M0 0h1" stroke="red" stroke-width="1e9"/>'), "a stroke 1e+09 wide"),
        (svg('<path d="M0 0c1 2 3"/>'), "'c' in path data has 3 numbers; it takes 6 each time"),
        (svg('<path d="M0 0x1"/>'), "'x' in path data is no command"),
        (svg('<path d="L1 1"/>'), "path data begin with 'L1 1', not with M"),
        (svg('<path d="M0 0h1" transform="turn(3)"/>'), "the transform 'turn(3)' is none that SVG knows"),
        (svg("", 'viewBox="0 0 0 5"'), "the canvas, 0 × 5, has a side not in"),
        (svg("", 'viewBox="0 0 1"'), "the viewBox '0 0 1' is not four numbers"),
        (svg("", 'width="1e9" height="2"'), "the canvas, 1e+09 × 2, has a side not in"),
        (b"<?xml version='1.0' encoding='cp037'?><svg/>", "is in the encoding 'cp037'; save it as UTF-8"),
        (svg("<g id='\u00e9'/>").decode().encode("latin-1"), "is no sound XML: not well-formed"),
        (svg("<metadata><s:settings>[1]</s:settings></metadata>"), "the settings are no JSON object"),
        (svg("<metadata><s:source width='0' height='1'/></metadata>"), "a photo of 0 × 1 pixels is none"),
        (svg('<path s:d="M0 0h1" s:width="1" s:pressure="1 1 1" d="M0 0h1"/>'), "3 values; the stroke has 2 on-"),
        (svg('<path s:d="M0 0h1" s:width="x" d="M0 0h1"/>'), "width, pressure and angle of strokeplan are numbers"),
        (svg("<style>" + "a b{fill:red}" * 1001 + "</style>"), "more than 1,000 compound selectors"),
    ],
)  # fmt: skip
def test_a_bad_file_is_refused_in_one_line(data: bytes, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(svg_reader, "MAX_USED", 1000)
    assert message in fault(data)


def test_limits_stop_what_is_too_large(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.svgz"
    bomb.write_bytes(gzip.compress(bytes(50 << 20), compresslevel=1))
    monkeypatch.setattr(svg_reader, "MAX_BYTES", 1 << 20)
    with pytest.raises(FormatError, match=r"bomb\.svgz: holds more than 1 MB"):
        strokeplan.load(bomb)
    monkeypatch.setattr(svg_xml, "MAX_ELEMENTS", 10)
    assert "has more than 10 elements" in fault(svg("<g/>" * 10))
    monkeypatch.setattr(svg_reader, "MAX_USED_DATA", 10)
    assert "uses show more than" in fault(svg(f'<path id="a" d="M0 0{"h1" * 500}"/>' + '<use href="#a"/>' * 5))


def test_illustrator_s_entities_and_doctypes_are_read() -> None:
    head = b'<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://localhost/svg11.dtd" [<!ENTITY c "#ff0000">]>'
    assert decode(head + svg('<path d="M0 0h1" fill="none" stroke="&c;"/>')).colors.tolist() == [[255, 0, 0]]


def test_other_encodings_are_read() -> None:
    text = svg(f'<g id="\u00e9"><path {LINE}/></g>').decode()
    assert decode(text.encode("utf-16")).layers[0].name == "\u00e9"
    declared = '<?xml version="1.0" encoding="iso-8859-1"?>' + text
    assert decode(declared.encode("latin-1")).layers[0].name == "\u00e9"


@given(st.binary(max_size=200) | st.binary(max_size=60).map(lambda inside: b"<svg>" + inside + b"</svg>"))
def test_bytes_are_a_plan_or_a_format_error(data: bytes) -> None:
    assert_harmless(data)


@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 8), st.binary(max_size=6)), min_size=1, max_size=4),
       st.sampled_from(["foreign.svg", "tiny.svg"]))  # fmt: skip
def test_a_damaged_file_is_a_plan_or_a_format_error(edits: list[tuple[int, int, bytes]], name: str) -> None:
    data = (GOLDEN / name).read_bytes()
    for place, count, new in edits:
        place %= len(data) + 1
        data = data[:place] + new + data[place + count :]
    assert_harmless(data)


def assert_harmless(data: bytes) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StrokeplanWarning)
        try:
            plan = decode(data)
        except FormatError:
            return
    assert isinstance(plan, StrokePlan)


def test_layer_and_source_of_a_plan_by_hand() -> None:
    plan = decode(document(TINY))
    assert plan.layers == (Layer("wide", 0, 2), Layer("fine & last", 2, 3, "ink", "butt"))
    assert plan.source == Source("tiny.png", "00ff" * 16, 20, 10)
