"""The command in vpype itself, and what its files hold by an XML parser of its own and curves measured anew."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import strokeplan
from strokeplan.errors import InputError
from strokeplan.strokes import Layer, StrokePlan

vpype_cli = pytest.importorskip("vpype_cli", reason="vpype is not installed, or not made for this Python")
vp = pytest.importorskip("vpype")

from strokeplan import vpype_plugin  # noqa: E402

SVG = "{http://www.w3.org/2000/svg}"
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
PX_PER_MM = 96 / 25.4
PIECES = np.array([[[0, 0], [0, 30], [30, 30], [30, 0]], [[5, 5], [20, 9], [30, 60], [80, 50]]], float)


@dataclass(frozen=True)
class Group:
    """A layer of an SVG that vpype wrote."""

    label: str
    color: str
    pen_width: float
    lines: list[NDArray[np.float64]]

    @property
    def length(self) -> float:
        return sum(float(np.hypot(*np.diff(line, axis=0).T).sum()) for line in self.lines)


def groups(path: Path) -> list[Group]:
    found = []
    for group in ElementTree.parse(path).getroot().iter(f"{SVG}g"):  # noqa: S314 — written a moment ago
        width = float(group.attrib["stroke-width"])
        found.append(Group(group.attrib[LABEL], group.attrib["stroke"], width, [_line(shape) for shape in group]))
    return found


def _line(shape: ElementTree.Element) -> NDArray[np.float64]:
    if shape.tag == f"{SVG}line":
        values = [shape.attrib[name] for name in ("x1", "y1", "x2", "y2")]
    else:
        values = shape.attrib["points"].replace(",", " ").split()
    points = np.array(values, float).reshape(-1, 2)
    return np.concatenate([points, points[:1]]) if shape.tag == f"{SVG}polygon" else points


def curve_lengths(plan: StrokePlan) -> NDArray[np.float64]:
    """Of every stroke, from the speed of its cubics by Gauss's rule: no flattening at all."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    t, lengths = (nodes[:, None] + 1) / 2, []
    for chain in plan:
        total = 0.0
        for c in range(0, len(chain) - 1, 3):
            d = 3 * np.diff(chain[c : c + 4], axis=0)
            speed = (1 - t) ** 2 * d[0] + 2 * (1 - t) * t * d[1] + t**2 * d[2]
            total += float(np.hypot(*speed.T) @ weights) / 2
        lengths.append(total)
    return np.array(lengths)


def colored(colors: list[str], layers: list[int], **columns: Any) -> StrokePlan:
    """A plan of one stroke a colour; `layers` says how many each layer has."""
    n = len(colors)
    ends = np.cumsum([0, *layers]).tolist()
    return StrokePlan(
        width=100,
        height=50,
        points=np.concatenate([PIECES[i % 2] + i for i in range(n)]),
        starts=np.arange(n + 1) * 4,
        widths=columns.pop("widths", np.full(n, 2.0)),
        colors=np.array([list(bytes.fromhex(color[1:])) for color in colors], np.uint8),
        layers=tuple(Layer(f"{k + 1}", ends[k], ends[k + 1]) for k in range(len(layers))),
        **columns,
    )


def added(plan: StrokePlan, **options: Any) -> dict[int, tuple[str, str, float, int]]:
    """Name, colour, pen width and number of lines of every layer."""
    document = vp.Document()
    vpype_plugin.add_plan(document, plan, **options)
    names = ("vp_name", "vp_color", "vp_pen_width")
    found = {number: [*map(layer.property, names), len(layer)] for number, layer in document.layers.items()}
    return {number: (name, color.as_rgb_hex(), width, count) for number, (name, color, width, count) in found.items()}


@pytest.fixture
def photo(tmp_path: Path, small_picture: NDArray[np.uint8]) -> Path:
    Image.fromarray(small_picture).save(tmp_path / "photo.png")
    return tmp_path / "photo.png"


def run(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vpype_cli", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def test_photo_goes_through_vpype_to_a_file(photo: Path, tmp_path: Path) -> None:
    """The whole way, as a user types it: every layer, colour and width of the plan, and the length of its curves."""
    out = tmp_path / "out.svg"
    ended = run(
        "strokeplan", photo, "--preset", "paper", "--palette", "3", "--seed", 5, "--width", "180mm",
        "--tolerance", "0.01mm", "linesort", "write", out,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    style = strokeplan.load_preset("paper").override({"palette_size": 3})
    plan = strokeplan.plan(photo, style, seed=5)
    scale = 180 * PX_PER_MM / plan.width
    lengths = curve_lengths(plan) * scale
    expected: dict[tuple[int, str, float], tuple[float, int]] = {}
    for number, layer in enumerate(plan.layers, start=1):
        for i in range(layer.first, layer.last):
            key = (number, "#" + bytes(plan.colors[i]).hex(), round(plan.widths[i] * scale, 2))
            length, count = expected.get(key, (0.0, 0))
            expected[key] = (length + lengths[i], count + 1)
    found = groups(out)
    assert {(int(g.label.split()[2]), g.color, round(g.pen_width, 2)): len(g.lines) for g in found} == {
        key: count for key, (_, count) in expected.items()
    }
    for group in found:
        number, layer_word, layer_name, color = group.label.split()
        assert (layer_word, color) == ("layer", group.color)
        length, _ = expected[int(layer_name), color, round(group.pen_width, 2)]
        assert group.length == pytest.approx(length, rel=1e-3)
    root = ElementTree.parse(out).getroot()  # noqa: S314
    assert float(root.attrib["width"].removesuffix("cm")) == pytest.approx(18, abs=1e-4)
    assert float(root.attrib["height"].removesuffix("cm")) == pytest.approx(18 * plan.height / plan.width, abs=1e-4)


def test_command_is_found_by_its_entry_point() -> None:
    """Whatever vpype makes of a plugin that fails, its help would not be this one."""
    listing = run("--help").stdout
    assert "Plan the strokes of a photo, or read a strokes file." in listing
    assert "Warning" not in listing
    assert "--layer-by" in run("strokeplan", "--help").stdout


def test_vpype_starts_without_the_planner() -> None:
    heavy = {"numba", "skimage", "msgspec", "typer"}
    code = f"import sys, strokeplan.vpype_plugin; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_strokes_file_is_read_and_lines_follow_its_curves(tmp_path: Path) -> None:
    plan = colored(["#ff0000", "#00ff00", "#ff0000"], [2, 1])
    plan.save(tmp_path / "plan.json.gz")
    document = vpype_cli.execute(f"strokeplan --tolerance 0.001px {tmp_path / 'plan.json.gz'}")
    lines = [document.layers[1][0], document.layers[2][0], document.layers[3][0]]
    lengths = [float(np.abs(np.diff(line)).sum()) for line in lines]
    # Green is the lighter of the two, so it comes first in its layer.
    assert lengths == pytest.approx(curve_lengths(plan)[[1, 0, 2]], rel=1e-4)
    assert [lines[1][0], lines[1][-1]] == [0, 30]
    assert document.page_size == (100, 50)
    assert {path.name for path in document.sources} == {"plan.json.gz"}


def test_layers_are_exact_while_there_are_few() -> None:
    plan = colored(["#000000", "#ffff00", "#000000"], [2, 1], widths=np.array([2.0, 2.0, 3.0]))
    assert added(plan, width=200.0) == {
        1: ("1 layer 1 #ffff00", "#ffff00", 4.0, 1),
        2: ("2 layer 1 #000000", "#000000", 4.0, 1),
        3: ("3 layer 2 #000000", "#000000", 6.0, 1),
    }


def test_widths_are_the_first_to_go(caplog: pytest.LogCaptureFixture) -> None:
    n = vpype_plugin.MAX_EXACT + 1
    plan = colored(["#000000", *["#ffffff"] * (n - 1)], [n], widths=np.arange(1.0, n + 1))
    median = float(np.median(np.arange(2.0, n + 1)))
    assert added(plan) == {
        1: ("1 layer 1 #ffffff", "#ffffff", median, n - 1),
        2: ("2 layer 1 #000000", "#000000", 1.0, 1),
    }
    assert "pen width" in caplog.text


def test_many_colours_become_a_layer_each_of_the_plan(caplog: pytest.LogCaptureFixture) -> None:
    n = vpype_plugin.MAX_EXACT + 1
    plan = colored([f"#{k:02x}0000" for k in range(n)], [n - 1, 1])
    mean = f"#{round(np.mean(range(n - 1))):02x}0000"
    assert added(plan) == {1: ("1", mean, 2.0, n - 1), 2: ("2", f"#{n - 1:02x}0000", 2.0, 1)}
    assert "--palette" in caplog.text
    caplog.clear()
    assert len(added(plan, layer_by="color")) == n  # asked for, so neither bounded nor noted
    assert caplog.text == ""


def test_layers_by_colour_and_by_pen() -> None:
    plan = colored(["#000000", "#ffff00", "#000000"], [2, 1], pens=("fine", None, "broad"))
    assert [entry[0] for entry in added(plan, layer_by="color").values()] == ["1 #ffff00", "2 #000000"]
    assert [entry[0] for entry in added(plan, layer_by="pen").values()] == ["1", "2 broad", "3 fine"]
    with pytest.raises(InputError, match="names a pen"):
        added(replace(plan, pens=None), layer_by="pen")


def test_plan_comes_after_what_is_there_or_into_the_layer_asked_for(tmp_path: Path) -> None:
    plan = colored(["#000000", "#ffff00"], [2])
    plan.save(tmp_path / "plan.json")
    after = vpype_cli.execute(f"line -l 3 0 0 9 9 strokeplan {tmp_path / 'plan.json'}")
    assert {number: len(layer) for number, layer in after.layers.items()} == {3: 1, 4: 1, 5: 1}
    assert after.layers[4].property("vp_name") == "4 layer 1 #ffff00"
    into = vpype_cli.execute(f"line -l 3 0 0 9 9 strokeplan -l 3 {tmp_path / 'plan.json'}")
    assert {number: len(layer) for number, layer in into.layers.items()} == {3: 3}


def test_stroke_with_pressure_has_its_mean_width() -> None:
    plan = colored(["#000000", "#ffffff"], [2], pressures=np.array([0.2, 0.6, np.nan, np.nan]))
    assert [entry[2] for entry in added(plan).values()] == pytest.approx([2.0, 0.8])


def test_both_sizes_fit() -> None:
    document = vp.Document()
    vpype_plugin.add_plan(document, colored(["#000000"], [1]), width=400, height=100)
    assert document.page_size == (200, 100)


def test_empty_plan_adds_no_layer() -> None:
    empty = replace(
        colored(["#000000"], [1]), points=np.empty((0, 2)), starts=np.zeros(1, np.int64), widths=np.empty(0),
        colors=np.empty((0, 3), np.uint8), layers=(Layer("1", 0, 0),),
    )  # fmt: skip
    assert added(empty) == {}


@pytest.mark.parametrize("way", vpype_plugin.WAYS[:3])
def test_no_stroke_is_lost_whatever_makes_a_layer(small_plan: StrokePlan, way: str) -> None:
    assert sum(entry[3] for entry in added(small_plan, layer_by=way).values()) == len(small_plan)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["photo.png", "--preset", "nope"], "unknown preset 'nope'"),
        (["photo.png", "--set", "layers.1.width=-1"], "layers.1.width = -1"),
        (["photo.png", "--palette", "0"], "palette"),
        (["plan.json", "--seed", "3"], "--seed plans a photo"),
        (["plan.json", "--set", "cap=butt"], "--set plans a photo"),
        (["plan.json", "--width", "0mm"], "--width 0 is not above 0"),
        (["plan.json", "--tolerance", "0"], "--tolerance 0 is not above 0"),
        (["plan.json", "--tolerance", "nan"], "cannot convert value 'nan'"),
        (["broken.json"], "broken.json"),
        (["notes.txt"], "is not a picture"),
        (["gone.jpg"], "does not exist"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    words: list[str], complaint: str, photo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from click.testing import CliRunner

    monkeypatch.chdir(photo.parent)
    colored(["#000000"], [1]).save("plan.json")
    Path("broken.json").write_text("{")
    Path("notes.txt").write_text("no photo")
    result = CliRunner().invoke(vpype_cli.cli, ["strokeplan", *words])
    assert result.exit_code == 2
    errors = [line for line in result.output.splitlines() if line.startswith("Error: ")]
    assert len(errors) == 1
    assert complaint in errors[0]


@pytest.mark.parametrize(
    "words",
    [
        ["--seed", "3", "FILE", "--preset=x", "-p", "x"],
        ["FILE", "-p", "x", "--seed", "3"],
        ["-px", "--seed", "3", "FILE"],
    ],
)
def test_options_stand_before_the_file_or_after_it(
    words: list[str], monkeypatch: pytest.MonkeyPatch, photo: Path
) -> None:
    seen = {}

    def plan(file: Path, style: dict[str, Any]) -> StrokePlan:
        seen.update(style, file=file)
        return colored(["#000000"], [1])

    monkeypatch.setattr(vpype_plugin, "_plan", plan)
    words = [str(photo) if word == "FILE" else word for word in words]
    document = vpype_cli.execute(" ".join(["strokeplan", *words, "translate", "--", "-5", "0"]))
    assert seen == {"file": photo, "seed": 3, "preset": "x"}
    assert document.layers[1][0][0] == -5  # the next command got what is its own


def test_vpype_keeps_layers_and_names_of_our_svg(tmp_path: Path, small_plan: StrokePlan) -> None:
    """The other way in: what vpype's own reader makes of a drawing, and nothing of its background."""
    small_plan.save(tmp_path / "drawing.svg")
    document = vpype_cli.execute(f"read --no-crop {tmp_path / 'drawing.svg'}")
    filled = {number: layer for number, layer in enumerate(small_plan.layers, start=1) if layer.last > layer.first}
    assert set(filled) == set(document.layers)
    for number, layer in filled.items():
        assert document.layers[number].property("vp_name") == layer.name
        assert len(document.layers[number]) == layer.last - layer.first
    assert document.page_size == (small_plan.width, small_plan.height)
