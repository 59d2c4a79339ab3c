"""The Inkscape extension: run as Inkscape runs it, judged by other renderers, and run by Inkscape itself."""

from __future__ import annotations

import base64
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import need_program
from numpy.typing import NDArray
from PIL import Image

import strokeplan
from strokeplan import inkscape
from strokeplan.errors import OutputError
from strokeplan.presets import names

FOLDER = Path(inkscape.__file__).parent
SCRIPT = FOLDER / "strokeplan_plan.py"
DIALOG = FOLDER / "strokeplan_plan.inx"
INX = "{http://www.inkscape.org/namespace/inkscape/extension}"
SVG = "{http://www.w3.org/2000/svg}"
INK = "{http://www.inkscape.org/namespaces/inkscape}"
HREF = "{http://www.w3.org/1999/xlink}href"
BUNDLED = Path("/usr/share/inkscape/extensions")
BLOCK = 20
"""Side in pixels of the blocks of one colour that the small photo consists of, so that smoothing hardly shows."""

needs_inkex = pytest.mark.skipif(
    importlib.util.find_spec("inkex") is None, reason="inkex is not installed (pip install --no-deps inkex)"
)
FAKE = """#!{python}
import json, pathlib, sys
from PIL import Image
photo, out = sys.argv[2], sys.argv[4]
pathlib.Path({log!r}).write_text(json.dumps(sys.argv[1:]))
picture, side = Image.open(photo).convert("RGB"), {side}
paths = [
    f'<path fill="#{{bytes(picture.getpixel((x, y))).hex()}}" d="M{{x}},{{y}}h{{side}}v{{side}}h-{{side}}z"/>'
    for y in range(0, picture.height, side) for x in range(0, picture.width, side)
]
pathlib.Path(out).write_text(
    f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
    f'xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 {{picture.width}} {{picture.height}}">'
    f'<defs><rect id="sheet" width="100%" height="100%"/></defs><use id="background" xlink:href="#sheet" fill="#000"/>'
    f'<g id="layer1" inkscape:groupmode="layer" inkscape:label="1" shape-rendering="crispEdges">'
    f'<path stroke="red" stroke-width="0.001" d="M-60,-60h1v1z"/>{{"".join(paths)}}</g></svg>'
)
"""


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """6 × 4 blocks, every one of another colour."""
    blocks = np.random.default_rng(1).integers(0, 255, (4, 6, 3), np.uint8)
    Image.fromarray(np.kron(blocks, np.ones((BLOCK, BLOCK, 1), np.uint8))).save(tmp_path / "a photo.png")
    return tmp_path / "a photo.png"


@pytest.fixture(scope="module")
def script() -> Any:
    """The extension as a module."""
    spec = importlib.util.spec_from_file_location("strokeplan_plan", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def fake(tmp_path: Path) -> Path:
    """A program in the place of strokeplan that traces blocks exactly and at once, and notes how it was called."""
    program = tmp_path / "fake-strokeplan"
    program.write_text(FAKE.format(python=sys.executable, log=str(tmp_path / "called.json"), side=BLOCK))
    program.chmod(0o755)
    return program


def document(folder: Path, image: str, around: str = "") -> Path:
    """A page with one image; `around` are attributes of a layer and of a group that hold it."""
    layer, _, group = around.partition("|")
    (folder / "in.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" width="200" height="160" viewBox="0 0 200 160">'
        f'<defs><clipPath id="trim1"><circle cx="90" cy="70" r="45"/></clipPath></defs>'
        f'<g inkscape:groupmode="layer" {layer}><g {group}><image id="image1" {image}/></g><rect id="strokes1"/></g>'
        "</svg>"
    )
    return folder / "in.svg"


def run(svg: Path, *words: str, script: Path = SCRIPT, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(script), "--id=image1", *words, str(svg)]
    env = {key: value for key, value in os.environ.items() if key != "DOCUMENT_PATH"} | environment
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=env, cwd="/")


def run_well(svg: Path, *words: str, **options: Any) -> ElementTree.Element:
    ended = run(svg, *words, **options)
    assert ended.returncode == 0, ended.stderr
    svg.with_name("out.svg").write_text(ended.stdout)
    return ElementTree.fromstring(ended.stdout)  # noqa: S314 — made a moment ago


def picture(svg: Path) -> NDArray[np.int64]:
    png = svg.with_suffix(".png")
    command = [need_program("rsvg-convert"), "--zoom", "4", "-b", "white", "-o", str(png), str(svg)]
    subprocess.run(command, check=True, timeout=60)
    return np.asarray(Image.open(png).convert("RGB")).astype(np.int64)


def differing(a: NDArray[np.int64], b: NDArray[np.int64]) -> float:
    """Part of the pixels in which two pictures differ by more than antialiasing of a few edges does."""
    return float(np.mean(np.abs(a - b).max(axis=2) > 40))


AROUND = 'transform="translate(9,4)"|transform="rotate(5)"'
PLACES = [
    ('x="20" y="10" width="120" height="80"', ""),
    ('x="20" y="10" width="100" height="120"', AROUND),
    ('x="20" y="10" width="100" height="120" preserveAspectRatio="none"', ""),
    ('x="20" y="10" width="100" height="120" preserveAspectRatio="xMinYMax meet"', ""),
    ('x="20" y="10" width="100" height="120" preserveAspectRatio="xMidYMid slice"', ""),
    ('x="20" y="10" width="100" height="40" preserveAspectRatio="xMaxYMin slice"', AROUND),
    ('x="20" y="10" width="120" height="80" transform="rotate(9) skewX(7) scale(1.1)"', AROUND),
    ('x="20" y="10" width="120" height="80" transform="translate(4)" clip-path="url(#trim1)"', AROUND),
]


@needs_inkex
@pytest.mark.parametrize(
    ("place", "around"), [*PLACES[4:7:2], PLACES[7], *(pytest.param(*each, marks=pytest.mark.slow) for each in
                          (*PLACES[:4], PLACES[5]))]
)  # fmt: skip
def test_strokes_stand_where_the_image_stood(place: str, around: str, tmp_path: Path, photo: Path, fake: Path) -> None:
    """librsvg shows the same picture before and after, with the image hidden: place, transforms, crop and clip."""
    embedded = "data:image/png;base64," + base64.b64encode(photo.read_bytes()).decode()
    svg = document(tmp_path, f'{place} xlink:href="{embedded}"', around)
    run_well(svg, f"--program={fake}")
    before, after = picture(svg), picture(tmp_path / "out.svg")
    aside = min(differing(before, np.roll(after, 12, axis=axis)) for axis in (0, 1))  # three units away
    assert differing(before, after) < 0.4 * aside  # librsvg smoothes the edges of blocks in an image


@needs_inkex
def test_layers_lie_over_the_image_in_the_nearest_layer(tmp_path: Path, photo: Path, fake: Path) -> None:
    root = run_well(document(tmp_path, f'width="120" height="80" href="{quote(photo.name)}"'), f"--program={fake}")
    layer = root.find(f"{SVG}g")
    assert layer is not None
    plain, strokes, after = list(layer)
    assert plain.find(f"{SVG}image").attrib["style"] == "display:none"  # type: ignore[union-attr]
    assert after.attrib["id"] == "strokes1"  # what was over the image is over the strokes
    assert strokes.attrib[f"{INK}groupmode"] == "layer"
    assert strokes.attrib[f"{INK}label"] == "a photo.png, fine"
    assert [part.get(f"{INK}label") for part in strokes] == ["background", "1"]
    ids = [element.attrib["id"] for element in root.iter() if "id" in element.attrib]
    assert len(ids) == len(set(ids))


@needs_inkex
def test_options_of_the_dialog_reach_the_command(tmp_path: Path, photo: Path, fake: Path) -> None:
    svg = document(tmp_path, f'width="120" height="80" xlink:href="{photo.as_uri()}"')
    root = run_well(
        svg, f"--program={fake}", "--preset=sketch", "--strokes=50", "--detail=0.75", "--palette= 6 ", "--seed=3",
        "--image=remove", "--background=false", "--trim=false",
    )  # fmt: skip
    words = json.loads((tmp_path / "called.json").read_text())
    assert words[:2] == ["plan", str(photo)]
    assert " ".join(words[4:]) == "--quiet --preset sketch --seed 3 --strokes 50 --detail 0.75 --palette 6"
    assert root.find(f".//{SVG}image") is None
    assert [path.get("id") for path in root.iter(f"{SVG}clipPath")] == ["trim1"]
    assert root.find(f".//{SVG}rect[@fill]") is None
    run_well(svg, f"--program={fake}", "--image=keep")
    words = json.loads((tmp_path / "called.json").read_text())
    assert " ".join(words[4:]) == "--quiet --preset fine --seed 0"  # what is as by default is not said


@needs_inkex
@pytest.mark.parametrize("href", ["photo.png", "./photo.png", "sub/../photo.png"])
def test_linked_image_is_found_beside_the_copy_or_the_document(
    href: str, tmp_path: Path, photo: Path, fake: Path
) -> None:
    """Inkscape hands extensions a copy in another folder, and says where the document is."""
    (tmp_path / "home" / "sub").mkdir(parents=True)
    shutil.copy(photo, tmp_path / "home" / "photo.png")
    svg = document(tmp_path, f'width="120" height="80" xlink:href="{href}"')
    run_well(svg, f"--program={fake}", DOCUMENT_PATH=str(tmp_path / "home" / "drawing.svg"))
    assert json.loads((tmp_path / "called.json").read_text())[1] == str(tmp_path / "home" / "photo.png")


@needs_inkex
@pytest.mark.parametrize(
    ("href", "complaint"),
    [
        ("http://example.org/cat.jpg", "images are not fetched"),
        ("gone.jpg", "gone.jpg: there is no such file"),
        ("data:image/png;base64,!!!", "embedded data are damaged"),
        ("data:image/png;base64,aGVsbG8=", "not a picture"),
        ("", "links to no file"),
    ],
)
def test_image_that_cannot_be_had_is_one_line_and_no_document(href: str, complaint: str, tmp_path: Path) -> None:
    installed = inkscape.install(tmp_path / "extensions")[1]  # beside which it is said how strokeplan is called
    ended = run(document(tmp_path, f'width="12" height="8" xlink:href="{href}"'), script=installed)
    assert ended.returncode != 0
    assert complaint in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
    assert ended.stdout == ""


@needs_inkex
@pytest.mark.parametrize(
    "href",
    [
        "HTTPS://example.org/cat.jpg", "ftp://example.org/cat.jpg", "//example.org/cat.jpg",
        "file://example.org/cat.jpg", "file:////example.org/cat.jpg", "\\\\example.org\\cat.jpg",
    ],
)  # fmt: skip
def test_nothing_is_fetched_from_elsewhere(href: str, script: Any) -> None:
    with pytest.raises(script.inkex.AbortExtension, match="images are not fetched"):
        script.local_path(href)


@needs_inkex
def test_what_strokeplan_complains_of_is_shown(tmp_path: Path, photo: Path) -> None:
    installed = inkscape.install(tmp_path / "extensions")[1]
    svg = document(tmp_path, f'width="120" height="80" xlink:href="{photo.as_uri()}"')
    ended = run(svg, "--strokes=9", "--detail=0.6", script=installed)
    assert ended.stderr.strip() == "error: strokes 9 and detail 0.6 are two budgets; give one of them"
    assert "gone: cannot be run" in run(svg, "--program=gone").stderr
    assert "run `strokeplan inkscape install` once" in run(svg, PATH=str(tmp_path)).stderr
    svg.write_text(svg.read_text().replace("<image", "<rect"))
    assert run(svg, script=installed).stderr.strip().startswith("Select a bitmap image first")


@needs_inkex
@pytest.mark.parametrize("inkex", ["installed", "Inkscape's"])
def test_installed_extension_plans_like_the_command(inkex: str, tmp_path: Path, sample_photo: Path) -> None:
    """With the real strokeplan, found by what `install` wrote; the layers are those of the plan."""
    if inkex != "installed" and not (BUNDLED / "inkex").is_dir():
        pytest.skip("Inkscape is not installed")
    script = inkscape.install(tmp_path / "extensions")[1]
    svg = document(tmp_path, f'width="120" height="80" xlink:href="{sample_photo.as_uri()}"')
    # Inkscape's settings for its own Python must not reach strokeplan's.
    path = {} if inkex == "installed" else {"PYTHONPATH": str(BUNDLED)}
    root = run_well(svg, "--preset=paper", "--seed=4", script=script, **path)
    plan = strokeplan.plan(sample_photo, "paper", seed=4)
    layers = root.findall(f".//{SVG}g[@{INK}label='chelsea.jpg, paper']/{SVG}g")
    assert {layer.attrib[f"{INK}label"]: len(layer) for layer in layers} == {
        layer.name: layer.last - layer.first for layer in plan.layers
    }


def test_dialog_is_sound_and_fits_its_script() -> None:
    schema = BUNDLED / "inkscape.extension.rng"
    if schema.exists():
        command = [need_program("xmllint"), "--noout", "--relaxng", str(schema), str(DIALOG)]
        subprocess.run(command, check=True, capture_output=True, timeout=60)
    root = ElementTree.parse(DIALOG).getroot()  # noqa: S314 — our own
    shown = {param.attrib["name"] for param in root.iter(f"{INX}param")}
    taken = set(re.findall(r'add_argument\("--(\w+)"', SCRIPT.read_text()))
    assert shown == taken
    assert len(shown) == 10
    command_name = root.find(f"{INX}script/{INX}command")
    assert command_name is not None
    assert command_name.text == SCRIPT.name


def test_dialog_lists_every_preset() -> None:
    root = ElementTree.parse(DIALOG).getroot()  # noqa: S314 — our own
    listed = [option.attrib["value"] for option in root.findall(f".//{INX}param[@name='preset']/{INX}option")]
    assert listed[0] == "fine"  # what the command takes by default
    assert sorted(listed) == names()


def test_install_writes_the_extension_and_how_to_call_this_strokeplan(tmp_path: Path) -> None:
    written = inkscape.install(tmp_path / "new" / "extensions")
    assert [path.name for path in written] == [DIALOG.name, SCRIPT.name, "strokeplan_plan.json"]
    assert written[0].read_bytes() == DIALOG.read_bytes()
    assert written[1].read_bytes() == SCRIPT.read_bytes()
    command = json.loads(written[2].read_text())
    said = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=60, check=True).stdout
    assert said == f"strokeplan {strokeplan.__version__}\n"


def test_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="--folder"):
        inkscape.install(tmp_path / "file" / "extensions")


def test_folder_is_the_one_that_inkscape_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "inkscape"
    program.write_text("#!/bin/sh\necho /somewhere/else\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert inkscape.extensions_folder() == Path("/somewhere/else/extensions")
    program.write_text("#!/bin/sh\nexit 3\n")
    monkeypatch.setenv("INKSCAPE_PROFILE_DIR", str(tmp_path / "profile"))
    assert inkscape.extensions_folder() == tmp_path / "profile" / "extensions"


def test_commands_install_and_name_the_folder(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "strokeplan", "inkscape"]
    environment = os.environ | {"INKSCAPE_PROFILE_DIR": str(tmp_path / "profile")}
    folder = tmp_path / "profile" / "extensions"
    for words, expected in ((["path"], str(folder)), (["install"], "Extensions > Images > Paint with Strokes")):
        ended = subprocess.run(
            [*program, *words], capture_output=True, text=True, timeout=120, check=True, env=environment
        )
        assert expected in ended.stdout
    assert len(list(folder.iterdir())) == 3
    ended = subprocess.run(
        [*program, "install", "--folder", str(SCRIPT)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, len(ended.stderr.splitlines())) == (2, 1)


@pytest.mark.slow
@needs_inkex
def test_inkscape_runs_the_extension(tmp_path: Path, sample_photo: Path) -> None:
    """The whole way in Inkscape, whose actions for extensions need its window and so a display."""
    programs = [shutil.which(name) for name in ("inkscape", "xvfb-run")]
    if None in programs:
        pytest.skip("inkscape or xvfb-run is not installed")
    profile = tmp_path / "profile"
    inkscape.install(profile / "extensions")
    (profile / "preferences.xml").write_text(
        '<inkscape version="1"><group id="extensions" python-interpreter="' + sys.executable + '"/></inkscape>'
    )
    svg = document(tmp_path, f'x="30" y="40" width="120" height="80" xlink:href="{sample_photo.as_uri()}"')
    out = tmp_path / "out.svg"
    actions = f"select-by-id:image1;org.strokeplan.plan.noprefs;export-filename:{out};export-do"
    running = subprocess.Popen(
        [programs[1] or "", "-a", programs[0] or "", "--batch-process", f"--actions={actions}", str(svg)],
        env=os.environ | {"INKSCAPE_PROFILE_DIR": str(profile)}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip
    try:
        running.wait(timeout=240)  # an error would be shown in a dialog, which waits for ever
    finally:
        if running.poll() is None:
            os.killpg(running.pid, signal.SIGKILL)
    root = ElementTree.parse(out).getroot()  # noqa: S314 — Inkscape's
    layers = root.findall(f".//{SVG}g[@{INK}label='chelsea.jpg, fine']/{SVG}g")
    plan = strokeplan.plan(sample_photo)
    assert [len(layer) for layer in layers] == [layer.last - layer.first for layer in plan.layers]
    painted, photo = picture(out), np.asarray(Image.open(sample_photo).convert("RGB").resize((480, 319)))
    seen = painted[160:479, 120:600]
    assert np.abs(seen - photo).mean() < 25
    assert painted[:150].min() == 255  # nothing beside the image
