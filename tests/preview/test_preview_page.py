"""The page in a real browser: what it paints, what its controls, keys and gestures do, and that it asks nobody."""

from __future__ import annotations

import base64
import io
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import need_program
from numpy.typing import NDArray
from PIL import Image
from random_plans import first_strokes, random_plan

from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.program import program
from strokeplan.preview import encode, save_page
from strokeplan.preview.plotting import Plot, plot_of
from strokeplan.rendering import paint
from strokeplan.strokes import Layer, Source, StrokePlan

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update",
]  # fmt: skip
PSNR_DB = 34.0
"""Skia's edges against Cairo's, on random strokes that are nearly all edge, of colours far apart: 34.7 to 35.7 dB
measured. A planned photo has 43 to 48."""
PLANNED_PSNR_DB = 38.0
WRONG_PSNR_DB = 25.0
"""What a picture that lacks something stays below."""

Page = Any
OpenPage = Callable[..., Page]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    executable = os.environ.get("CHROMIUM") or need_program("chromium")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def plan() -> StrokePlan:
    return random_plan()


@pytest.fixture
def open_page(browser: Any, tmp_path: Path) -> Iterator[OpenPage]:
    """Open the page of a plan, painted; in the end nothing may have been fetched, logged or thrown."""
    contexts, complaints = [], []

    def opened(plan: StrokePlan, plot: Plot | None = None, **options: Any) -> Page:
        save_page(plan, tmp_path / "page.html", plot)
        context = browser.new_context(**({"viewport": {"width": 900, "height": 600}} | options))
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("dialog", lambda dialog: complaints.append(dialog.message))
        page.on("request", lambda asked: complaints.extend([asked.url] * (not asked.url.startswith(LOCAL))))
        page.goto((tmp_path / "page.html").as_uri())
        page.wait_for_selector("body[data-state=ready]")
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []


LOCAL = ("file:", "data:", "blob:")


def shown(page: Page) -> tuple[float, float, float, int]:
    """Scale, left and top of the picture on the canvas, and how many strokes are painted."""
    scale, left, top, painted = page.get_attribute("#picture", "data-shown").split()
    return float(scale), float(left), float(top), int(painted)


def settle(page: Page, painted: int | None = None) -> None:
    """Wait until the page has nothing left to paint, and has painted so many strokes."""
    page.evaluate("() => new Promise((done) => setTimeout(done, 120))")  # a new view waits until it has settled
    if painted is not None:
        page.wait_for_selector(f'#picture[data-shown$=" {painted}"]', state="attached")
    page.wait_for_selector("body[data-state=ready]")
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def scrub(page: Page, count: int) -> None:
    page.locator("#scrub").fill(str(count))
    settle(page, count)


def pixels(page: Page) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """The canvas, and which of its pixels the paper covers."""
    url = page.evaluate("() => document.getElementById('picture').toDataURL()")
    with Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))) as file:
        rgba = np.asarray(file.convert("RGBA"))
    return rgba[..., :3], rgba[..., 3] == 255


def expected(plan: StrokePlan, page: Page, rows: int, columns: int) -> NDArray[np.uint8]:
    """What Cairo paints where the page shows the plan."""
    scale, left, top, _ = shown(page)
    moved = replace(
        plan, width=columns, height=rows, points=plan.points * scale + (left, top), widths=plan.widths * scale
    )
    return paint(moved, columns, rows)


def psnr(page: Page, plan: StrokePlan) -> float:
    """How near the page is to the picture of a plan, on the paper."""
    picture, paper = pixels(page)
    assert paper.mean() > 0.3
    errors = (picture.astype(float) - expected(plan, page, *picture.shape[:2]))[paper]
    return float(10 * np.log10(255**2 / max(np.mean(errors**2), 1e-9)))


def counter(page: Page) -> int:
    settle(page)
    return int(page.inner_text("#counter").replace(",", ""))


def without_layer(plan: StrokePlan, layer: int) -> StrokePlan:
    """The plan with the strokes of a layer moved out of the picture."""
    points = plan.points.copy()
    points[plan.starts[plan.layers[layer].first] : plan.starts[plan.layers[layer].last]] += 1e5
    return replace(plan, points=points)


def test_the_finished_picture_is_shown_first(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    assert shown(page)[3] == len(plan)
    assert page.get_attribute("#play", "aria-label") == "Play"
    assert psnr(page, plan) > PSNR_DB
    assert psnr(page, first_strokes(plan, len(plan) - 40)) < WRONG_PSNR_DB


def test_a_planned_picture_is_painted_as_render_paints_it(open_page: OpenPage, small_plan: StrokePlan) -> None:
    assert psnr(open_page(small_plan), small_plan) > PLANNED_PSNR_DB


def test_pressure_is_painted(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    assert psnr(page, replace(plan, pressures=None)) < WRONG_PSNR_DB


def test_half_the_bar_is_the_first_half_of_the_strokes(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    scrub(page, 200)
    assert page.inner_text("#count") == "200 of 400"
    assert psnr(page, first_strokes(plan, 200)) > PSNR_DB
    assert psnr(page, plan) < WRONG_PSNR_DB


@pytest.mark.slow
def test_going_back_and_forth_ends_in_the_same_pixels(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    scrub(page, 0)
    scrub(page, 217)
    before = pixels(page)[0]
    for count in (400, 30, 390, 217):
        scrub(page, count)
    assert np.array_equal(pixels(page)[0], before)


@pytest.mark.parametrize("layer", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_a_layer_goes_and_comes_back(layer: int, open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    whole = pixels(page)[0]
    box = page.get_by_role("checkbox").nth(layer)
    box.uncheck()
    settle(page)
    assert psnr(page, without_layer(plan, layer)) > PSNR_DB
    assert psnr(page, plan) < WRONG_PSNR_DB
    page.keyboard.press(str(layer + 1))
    assert box.is_checked()
    settle(page)
    assert np.array_equal(pixels(page)[0], whole)


def test_layers_are_named_and_counted(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    assert page.locator("#layer-list .name").all_inner_texts() == ["Layer 1", "middle", "fine & last"]
    assert page.locator("#layer-list .count").all_inner_texts() == ["40", "93", "267"]
    assert page.locator("#layer-list .about").all_inner_texts() == ["24 px, paint", "8.5 px, paint", "3 px, ink"]


def test_a_zoomed_picture_is_as_sharp(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    fit = shown(page)[0]
    for _ in range(4):
        page.keyboard.press("+")
    settle(page)
    assert shown(page)[0] == pytest.approx(fit * 1.5**4)
    assert psnr(page, plan) > PSNR_DB
    page.keyboard.press("0")
    settle(page)
    assert shown(page)[0] == fit


@pytest.mark.slow
def test_a_screen_of_more_pixels_shows_more(open_page: OpenPage, plan: StrokePlan) -> None:
    once = shown(open_page(plan))[0]
    page = open_page(plan, device_scale_factor=2)
    assert shown(page)[0] == pytest.approx(2 * once, rel=0.01)
    assert psnr(page, plan) > PSNR_DB


@pytest.mark.slow
def test_the_wheel_zooms_about_the_pointer_and_a_drag_pans(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    box = page.locator("#picture").bounding_box()
    x, y = 250.0, 200.0
    scale, left, top, _ = shown(page)
    place = (x - left) / scale, (y - top) / scale
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.wheel(0, -600)
    settle(page)
    scale, left, top, _ = shown(page)
    assert ((x - left) / scale, (y - top) / scale) == pytest.approx(place)
    page.mouse.down()
    page.mouse.move(box["x"] + x + 30, box["y"] + y + 12, steps=3)
    page.mouse.up()
    settle(page)
    assert shown(page)[:3] == pytest.approx((scale, left + 30, top + 12))
    page.mouse.dblclick(box["x"] + x, box["y"] + y)
    settle(page)
    assert shown(page)[0] < scale
    page.mouse.dblclick(box["x"] + x, box["y"] + y)
    settle(page)
    assert shown(page)[0] > scale / 2


def test_the_stroke_under_the_pointer_is_the_one_on_top(open_page: OpenPage, plan: StrokePlan) -> None:
    """Against a picture in which the colour of a stroke is its number."""
    page = open_page(plan)
    box = page.locator("#picture").bounding_box()
    codes = np.arange(1, len(plan) + 1)
    colors = np.stack([codes // 256, codes % 256, np.zeros_like(codes)], axis=1).astype(np.uint8)
    scale, left, top, _ = shown(page)
    rows, columns = round(box["height"]), round(box["width"])
    coded = replace(
        plan,
        width=columns,
        height=rows,
        points=plan.points * scale + (left, top),
        widths=plan.widths * scale,
        colors=colors,
        background=(0, 0, 0),
    )
    numbers = paint(coded, columns, rows, antialias=False).astype(int) @ (256, 1, 0)
    rng = np.random.default_rng(1)
    found = set()
    while len(found) < 25:
        x, y = int(rng.uniform(left, columns - left)), int(rng.uniform(top, rows - top))
        around = numbers[y - 2 : y + 3, x - 2 : x + 3]
        if around.shape != (5, 5) or np.ptp(around) or around[0, 0] in found:
            continue
        number = int(around[0, 0])
        page.mouse.move(box["x"] + x + 0.5, box["y"] + y + 0.5)
        if number:
            page.wait_for_selector(f"#ordinal:text-is('Stroke {number}')")
        else:
            page.wait_for_selector("body:not(.chosen)")
        found.add(number)


def test_a_stroke_is_described(open_page: OpenPage) -> None:
    k = 4 / 3 * np.tan(np.pi / 8)
    quarter = np.array([(150, 50), (150, 50 + 100 * k), (50 + 100 * k, 150), (50, 150)])
    plan = StrokePlan(
        width=200,
        height=200,
        points=np.concatenate([quarter, np.array([(10.0, 10), (20, 10), (30, 10), (40, 10)])]),
        starts=np.array([0, 4, 8]),
        widths=np.array([6.25, 8.0]),
        colors=np.array([(200, 30, 20), (0, 7, 255)], np.uint8),
        layers=(Layer("1", 0, 2),),
        pressures=np.array([np.nan, np.nan, 0.5, 1]),
        pens=(None, "blue one"),
    )
    page = open_page(plan)
    page.keyboard.press("]")
    card = page.locator(".card")
    length = 100 * np.pi / 2
    assert card.inner_text().split("\n")[:2] == ["Stroke 1", "Layer 1"]
    assert page.inner_text("#color") == "#c81e14"
    assert page.inner_text("#width") == "6.25 px"
    assert float(page.inner_text("#length").removesuffix(" px")) == pytest.approx(length, rel=0.01)
    assert page.locator("#pen-row").is_hidden()
    page.keyboard.press("]")
    assert page.inner_text("#width") == "4.02–8 px"  # pressure is kept in 255 steps
    assert page.inner_text("#length") == "30 px"
    assert page.inner_text("#pen") == "blue one"


def test_keys_do_what_the_overlay_says(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    press = page.keyboard.press
    for key, count in [
        ("Home", 0), (".", 1), ("ArrowRight", 3), ("Shift+ArrowRight", 23), (",", 22), ("ArrowLeft", 20),
        ("Shift+ArrowLeft", 0), ("End", 400), (".", 400),
    ]:  # fmt: skip
        press(key)
        assert counter(page) == count, key
    press("[")
    assert page.inner_text("#ordinal") == "Stroke 400"
    press("[")
    assert page.inner_text("#ordinal") == "Stroke 399"
    press("]")
    assert page.inner_text("#ordinal") == "Stroke 400"
    press("3")  # the layer of that stroke
    assert page.locator("body.chosen").count() == 0
    press("[")
    assert page.inner_text("#ordinal") == "Stroke 133"
    press("Escape")
    assert page.locator("body.chosen").count() == 0
    press("ArrowUp")
    assert page.inner_text("#speed") == "2×"
    press("ArrowDown")
    press("ArrowDown")
    assert page.inner_text("#speed") == "½×"
    press("?")
    assert page.locator("#keys").is_visible()
    press("Home")
    press("Escape")
    assert page.locator("#keys").is_hidden()
    assert counter(page) == 400
    press("l")
    assert page.get_attribute("#layers", "aria-expanded") == "false"
    assert page.locator("#layer-panel").is_hidden()


@pytest.mark.slow
def test_playing_goes_from_the_blank_canvas_to_the_end(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(first_strokes(plan, 30))
    for _ in range(4):
        page.keyboard.press("ArrowUp")
    page.evaluate(
        """() => {
            const counter = document.querySelector("#counter"), told = (window.told = []);
            const tell = () => told.push(Number(counter.textContent));
            new MutationObserver(tell).observe(counter, {childList: true, characterData: true, subtree: true});
        }"""
    )
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=Play]")
    settle(page, 30)
    told = page.evaluate("window.told")
    assert told[0] < 30  # it began anew
    assert told == sorted(told)
    assert psnr(page, first_strokes(plan, 30)) > PSNR_DB


@pytest.mark.slow
def test_pausing_stops(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    page.click("#play")
    page.wait_for_selector("#counter:not(:text-is('0')):not(:text-is('400'))")
    page.click("#play")
    count = counter(page)
    settle(page)
    assert counter(page) == count < 400
    assert psnr(page, first_strokes(plan, count)) > PSNR_DB


@pytest.mark.slow
def test_fingers_tap_pan_and_pinch(open_page: OpenPage, plan: StrokePlan) -> None:
    phone = {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2, "has_touch": True, "is_mobile": True}
    page = open_page(plan, **phone)
    assert page.locator("#layer-panel").is_hidden()
    assert page.evaluate("() => document.documentElement.scrollWidth") == 390
    fit = shown(page)[:3]
    box = page.locator("#picture").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    touch = page.context.new_cdp_session(page)

    def fingers(kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": px, "y": py, "id": k} for k, (px, py) in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    fingers("touchStart", (x, y))
    fingers("touchMove", (x + 40, y))
    fingers("touchEnd")
    settle(page)
    assert shown(page)[:3] == fit  # a picture that fits stays where it is
    fingers("touchStart", (x - 30, y), (x + 30, y))
    for spread in (40, 60, 90):
        fingers("touchMove", (x - spread, y), (x + spread, y))
    fingers("touchEnd")
    settle(page)
    scale, left, top, _ = shown(page)
    assert scale == pytest.approx(3 * fit[0], rel=0.02)
    fingers("touchStart", (x, y))
    fingers("touchMove", (x + 20, y))
    fingers("touchMove", (x + 25, y))
    fingers("touchEnd")
    settle(page)
    assert shown(page)[:3] == pytest.approx((scale, left + 50, top), abs=1)
    column, row = next(
        (int(2 * (x - box["x"]) + 6 * k), int(2 * (y - box["y"])))
        for k in range(20)
        if np.any(pixels(page)[0][int(2 * (y - box["y"])), int(2 * (x - box["x"]) + 6 * k)] != plan.background)
    )
    page.touchscreen.tap(box["x"] + column / 2, box["y"] + row / 2)
    page.wait_for_selector("body.chosen")
    assert page.locator(".card").is_visible()
    page.locator("#forget").tap()
    assert page.locator(".card").is_hidden()


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "dark"), [("light", False), ("dark", True)])
def test_the_theme_follows_the_system_and_the_switch(
    scheme: str, dark: bool, open_page: OpenPage, plan: StrokePlan
) -> None:
    page = open_page(plan, color_scheme=scheme)

    def is_dark() -> bool:
        color = page.evaluate("() => getComputedStyle(document.body).backgroundColor")
        return sum(map(int, color.removeprefix("rgb(").rstrip(")").split(","))) < 300

    assert is_dark() == dark
    page.click("#theme")
    assert is_dark() != dark


@pytest.mark.slow
def test_every_control_has_a_name(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(plan)
    for control in page.locator("button, input, canvas[role]").all():
        name = control.get_attribute("aria-label") or control.evaluate("(e) => e.closest('label')?.innerText ?? ''")
        assert name.strip(), control.evaluate("(e) => e.outerHTML")
    assert page.get_by_role("slider", name="Strokes painted").get_attribute("aria-valuetext") == "400 of 400 strokes"


HOSTILE = "</script></title><img src=x onerror=alert(1)><script>alert(2)</script>$style ${header} &amp;"


def test_names_from_a_plan_are_text(open_page: OpenPage, plan: StrokePlan) -> None:
    layers = tuple(replace(layer, name=HOSTILE + str(k)) for k, layer in enumerate(plan.layers))
    pens = (HOSTILE,) * len(plan)
    page = open_page(replace(plan, layers=layers, pens=pens, source=Source(HOSTILE, "", 300, 200)))
    assert page.title() == HOSTILE
    assert page.text_content("h1") == HOSTILE
    assert page.locator("#layer-list .name").first.text_content() == HOSTILE + "0"
    page.keyboard.press("]")
    assert page.text_content("#pen") == HOSTILE
    assert page.locator("img").count() == 1  # the poster


def test_the_policy_lets_no_other_script_run_and_nothing_load(browser: Any, plan: StrokePlan, tmp_path: Path) -> None:
    save_page(plan, tmp_path / "page.html")
    page = browser.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((tmp_path / "page.html").as_uri())
    page.wait_for_selector("body[data-state=ready]")
    asked.clear()
    page.evaluate(
        """() => {
            const script = document.createElement("script");
            script.textContent = "window.intruder = true";
            const image = document.createElement("img");
            image.src = "http://127.0.0.1:9/x.png";
            document.body.append(script, image);
            document.body.setAttribute("onclick", "window.intruder = true");
            document.body.click();
            return fetch("http://127.0.0.1:9/").catch(() => null);
        }"""
    )
    assert page.evaluate("() => window.intruder") is None
    page.close()


def test_without_script_the_poster_is_shown(browser: Any, plan: StrokePlan, tmp_path: Path) -> None:
    save_page(plan, tmp_path / "page.html")
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto((tmp_path / "page.html").as_uri())
    assert page.locator("#poster").is_visible()
    assert page.locator("#notice").inner_text() == "The strokes need JavaScript; this is the picture they make."
    context.close()


@pytest.mark.slow
def test_damaged_data_are_reported(browser: Any, plan: StrokePlan, tmp_path: Path) -> None:
    damaged = encode(plan).replace(b'"version":1', b'"version":9')
    (tmp_path / "page.html").write_bytes(damaged)
    page = browser.new_page()
    page.goto((tmp_path / "page.html").as_uri())
    page.wait_for_selector("body[data-state=failed]")
    assert "cannot show version 9" in page.inner_text("#notice")
    page.close()


@pytest.mark.slow
def test_without_pycairo_there_is_no_poster_but_a_page(
    open_page: OpenPage, plan: StrokePlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "cairo", None)
        page = open_page(plan)
    assert page.locator("#poster").count() == 0
    assert psnr(page, plan) > PSNR_DB


@pytest.mark.slow
def test_a_plan_without_strokes_is_blank_paper(open_page: OpenPage, plan: StrokePlan) -> None:
    page = open_page(first_strokes(plan, 0))
    picture, paper = pixels(page)
    assert np.all(picture[paper] == plan.background)
    page.keyboard.press("Space")
    page.keyboard.press("]")
    page.mouse.move(300, 300)
    settle(page)
    assert page.inner_text("#summary") == "0 strokes"


def test_the_same_plan_gives_the_same_page(plan: StrokePlan) -> None:
    assert encode(plan) == encode(plan)


def plotted() -> tuple[StrokePlan, Plot]:
    """Two pens on a machine that parks at the page's lower left corner."""
    bars = np.array([[10, 10], [20, 10], [30, 10], [40, 10], [10, 30], [20, 30], [30, 30], [40, 30.0]])
    plan = StrokePlan(
        100, 80, bars, np.array([0, 4, 8]), np.full(2, 0.5), np.zeros((2, 3), np.uint8), (Layer("1", 0, 2, "ink"),),
        settings={"page_mm": [100, 80]}, pens=("fine", "bold"),
    )  # fmt: skip
    return plot_of(program(plan, load_profile("grbl_servo")), (255, 255, 255))


def test_a_plot_shows_ways_and_time(open_page: OpenPage) -> None:
    """The bar is the machine's time; ways lead from home by the lines and the change of pens home again."""
    lines, plot = plotted()
    page = open_page(lines, plot=plot)
    settle(page)
    assert page.inner_text("#total") == page.inner_text("#counter") == f"0:00:{round(plot.total_s)}"
    assert float(page.get_attribute("#scrub", "max")) == pytest.approx(plot.total_s, abs=0.01)
    whole = blue(page)
    assert whole > 200
    page.locator("#scrub").evaluate("(bar, to) => { bar.value = to; bar.dispatchEvent(new Event('input')); }", 20)
    settle(page, 1)
    assert 0 < blue(page) < whole
    page.keyboard.press("w")
    settle(page)
    assert blue(page) == 0
    assert page.get_attribute("#show-ways", "aria-pressed") == "false"


def blue(page: Page) -> int:
    """How many pixels of the ways are drawn."""
    url = page.evaluate("() => document.getElementById('ways').toDataURL()")
    with Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))) as file:
        rgba = np.asarray(file.convert("RGBA"))
    return int(np.count_nonzero((rgba[..., 3] > 0) & (rgba[..., 2] > 150)))


def test_times_are_those_of_the_motion() -> None:
    lines, plot = plotted()
    assert lines.points[0] == pytest.approx([10, 10])
    assert [layer.name for layer in lines.layers] == ["fine", "bold"]
    assert np.all(np.diff(plot.done_s) > 20)  # a change of pen takes so long
    assert plot.home == pytest.approx((0, 80))
    assert plot.stops == ((1, 0.0, 80.0), (2, 0.0, 80.0))
