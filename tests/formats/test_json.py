"""The strokes file: what goes in comes out, and every fault is named."""

from __future__ import annotations

import gzip
import json
import math
import re
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from plans import TINY, assert_same, plans

import strokeplan
from strokeplan import FormatError, StrokePlan
from strokeplan.formats.json import decode, encode, schema
from strokeplan.strokes import Layer, Source

HERE = Path(__file__).parent
GOLDEN = HERE / "golden" / "tiny.json"
DOCUMENT = HERE.parent.parent / "docs" / "strokes-file.md"
SCHEMA = Path(strokeplan.__file__).parent / "formats" / "strokes-1.schema.json"
MISSING = object()


def edited(path: str, value: Any) -> bytes:
    """The golden file with the value at a path ("layers.0.name") put in, replaced, or taken out (MISSING)."""
    document = json.loads(GOLDEN.read_bytes())
    *parents, last = (int(step) if step.isdigit() else step for step in path.split("."))
    node = document
    for step in parents:
        node = node[step]
    if value is MISSING:
        del node[last]
    else:
        node[last] = value
    return json.dumps(document).encode()


def with_literal(path: str, literal: str) -> bytes:
    """The golden file with a piece of JSON text, valid or not, at a path."""
    return edited(path, "@@").replace(b'"@@"', literal.encode())


def fault(data: bytes) -> str:
    """What `decode` says of a wrong file."""
    with pytest.raises(FormatError) as caught:
        decode(data, "a.json")
    message = str(caught.value)
    assert message.startswith("a.json: ")
    assert "\n" not in message
    return message.removeprefix("a.json: ")


# What goes in comes out


@given(plans())
def test_a_plan_survives_its_file(plan: StrokePlan) -> None:
    data = encode(plan)
    again = decode(data)
    assert_same(again, plan)
    assert encode(again) == data


def test_a_planned_picture_survives_its_file_exactly(small_plan: StrokePlan, tmp_path: Path) -> None:
    for name in ("plan.json", "plan.json.gz", "PLAN.JSON"):
        small_plan.save(tmp_path / name)
        assert_same(strokeplan.load(tmp_path / name), small_plan)


def test_golden_file_is_read() -> None:
    assert_same(decode(GOLDEN.read_bytes()), TINY)


def test_golden_file_is_written() -> None:
    assert encode(TINY) == GOLDEN.read_bytes()


def test_whitespace_and_key_order_mean_nothing() -> None:
    document = json.loads(GOLDEN.read_bytes())
    turned = dict(reversed(document.items()))
    assert_same(decode(json.dumps(turned, indent=2).encode()), TINY)


def test_whole_numbers_may_be_written_without_a_point() -> None:
    assert_same(decode(GOLDEN.read_bytes().replace(b".0,", b",").replace(b".0]", b"]")), TINY)


def test_optional_fields_have_defaults() -> None:
    plan = decode(
        b'{"format": "strokeplan", "version": 1, "canvas": {"width": 3, "height": 2}, "layers": '
        b'[{"name": "", "strokes": [{"d": [0,0,1,1,2,1,3,2], "width": 1, "color": "#ABCDEF"}]}]}'
    )
    assert (plan.background, plan.source, plan.settings) == ((255, 255, 255), None, {})
    assert (plan.pressures, plan.angles, plan.pens) == (None, None, None)
    assert plan.layers == (Layer("", 0, 1, "paint", "round"),)
    assert plan.colors.tolist() == [[0xAB, 0xCD, 0xEF]]


def test_settings_hold_anything() -> None:
    settings = {"mine": {"é": [1, 2.5, None, True, "x", {"": []}]}, "big": 10**30}
    assert decode(edited("settings", settings)).settings == settings


def test_a_file_name_that_is_no_text_can_be_saved() -> None:
    source = Source("caf\udce9.jpg", "", 1, 1)  # what Python makes of a name in Latin-1
    plan = replace(TINY, source=source, settings={"preset": {"name": "\udcff"}})
    assert_same(decode(encode(plan)), plan)


# The schema


def validate(files: list[Path]) -> dict[str, Any]:
    """What check-jsonschema, an independent program, finds in strokes files."""
    command = [sys.executable, "-m", "check_jsonschema", "--output-format", "json", "--schemafile", SCHEMA, *files]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    found: dict[str, Any] = json.loads(run.stdout)
    assert (run.returncode == 0) == (found["status"] == "ok")
    return found


def test_shipped_schema_is_the_code_s() -> None:
    assert json.loads(SCHEMA.read_bytes()) == schema()


def test_schema_is_a_json_schema() -> None:
    command = [sys.executable, "-m", "check_jsonschema", "--check-metaschema", str(SCHEMA)]
    subprocess.run(command, check=True, capture_output=True)


def test_schema_takes_our_files(small_plan: StrokePlan, tmp_path: Path) -> None:
    small_plan.save(tmp_path / "planned.json")
    assert validate([GOLDEN, tmp_path / "planned.json"])["status"] == "ok"


# Every fault is named

WRONG: list[tuple[str, Any, str]] = [
    # path, value, what the message ends with or holds
    ("version", 0, "Invalid enum value 0 - at `$.version`"),
    ("version", "1", "Expected `int`, got `str` - at `$.version`"),
    ("version", True, "Expected `int`, got `bool` - at `$.version`"),
    ("version", MISSING, "missing required field `version`"),
    ("canvas", [], "Expected `object`, got `array` - at `$.canvas`"),
    ("canvas", MISSING, "missing required field `canvas`"),
    ("canvas.width", 0, "`float` >= 0.001 - at `$.canvas.width`"),
    ("canvas.width", "20", "Expected `float`, got `str` - at `$.canvas.width`"),
    ("canvas.height", -10, "`float` >= 0.001 - at `$.canvas.height`"),
    ("canvas.height", 1e7, "`float` <= 1000000.0 - at `$.canvas.height`"),
    ("canvas.background", "white", "at `$.canvas.background`"),
    ("canvas.depth", 1, "unknown field `depth` - at `$.canvas`"),
    ("source.width", 0.5, "Expected `int`, got `float` - at `$.source.width`"),
    ("source.height", 0, "`int` >= 1 - at `$.source.height`"),
    ("source.path", "/x", "unknown field `path` - at `$.source`"),
    ("settings", None, "Expected `object`, got `null` - at `$.settings`"),
    ("author", "me", "unknown field `author`"),
    ("layers", MISSING, "missing required field `layers`"),
    ("layers.1.name", 1, "Expected `str`, got `int` - at `$.layers[1].name`"),
    ("layers.1.medium", "blood", "Invalid enum value 'blood' - at `$.layers[1].medium`"),
    ("layers.1.cap", "square", "Invalid enum value 'square' - at `$.layers[1].cap`"),
    ("layers.1.opacity", 0.5, "unknown field `opacity` - at `$.layers[1]`"),
    ("layers.0.strokes", {}, "Expected `array`, got `object` - at `$.layers[0].strokes`"),
    ("layers.0.strokes.1.d", [1, 2, 3], "length >= 8 - at `$.layers[0].strokes[1].d`"),
    ("layers.0.strokes.1.d.7", None, "Expected `float`, got `null` - at `$.layers[0].strokes[1].d[7]`"),
    ("layers.0.strokes.1.d.7", 1e9, "`float` <= 10000000.0 - at `$.layers[0].strokes[1].d[7]`"),
    ("layers.0.strokes.1.d.7", -1e9, "`float` >= -10000000.0 - at `$.layers[0].strokes[1].d[7]`"),
    ("layers.0.strokes.1.width", 0, "`float` > 0.0 - at `$.layers[0].strokes[1].width`"),
    ("layers.0.strokes.1.width", -1, "`float` > 0.0 - at `$.layers[0].strokes[1].width`"),
    ("layers.0.strokes.1.width", 1e9, "`float` <= 1000000.0 - at `$.layers[0].strokes[1].width`"),
    ("layers.0.strokes.1.width", MISSING, "missing required field `width` - at `$.layers[0].strokes[1]`"),
    ("layers.0.strokes.1.color", "#12345", "at `$.layers[0].strokes[1].color`"),
    ("layers.0.strokes.1.color", "#1234567", "at `$.layers[0].strokes[1].color`"),
    ("layers.0.strokes.1.color", "#12345g", "at `$.layers[0].strokes[1].color`"),
    ("layers.0.strokes.1.color", "#123456\n", "at `$.layers[0].strokes[1].color`"),
    ("layers.0.strokes.1.hue", 0, "unknown field `hue` - at `$.layers[0].strokes[1]`"),
    ("layers.1.strokes.0.pen", 3, "Expected `str`, got `int` - at `$.layers[1].strokes[0].pen`"),
    ("layers.1.strokes.0.pressure", None, "Expected `array`, got `null` - at `$.layers[1].strokes[0].pressure`"),
    ("layers.1.strokes.0.pressure.1", 1.5, "`float` <= 1.0 - at `$.layers[1].strokes[0].pressure[1]`"),
    ("layers.1.strokes.0.pressure.1", -0.1, "`float` >= 0.0 - at `$.layers[1].strokes[0].pressure[1]`"),
    ("layers.1.strokes.0.angle", 1.5, "Expected `array`, got `float` - at `$.layers[1].strokes[0].angle`"),
    ("layers.1.strokes.0.angle.0", math.pi, "`float` < 3.14159265358"),
    ("layers.1.strokes.0.angle.1", -0.1, "`float` >= 0.0 - at `$.layers[1].strokes[0].angle[1]`"),
]


@pytest.mark.parametrize(("path", "value", "message"), WRONG)
def test_a_wrong_value_is_named_with_its_path(path: str, value: Any, message: str) -> None:
    assert message in fault(edited(path, value))


def test_schema_refuses_what_the_reader_refuses(tmp_path: Path) -> None:
    files = [tmp_path / f"{number}.json" for number in range(len(WRONG))]
    for file, (path, value, _) in zip(files, WRONG, strict=True):
        file.write_bytes(edited(path, value))
    refused = {Path(error["filename"]) for error in validate(files)["errors"]}
    assert refused == set(files)


@pytest.mark.parametrize("count", [9, 10, 13, 15])
def test_coordinates_that_are_no_chain_of_cubics_are_refused(count: int) -> None:
    said = fault(edited("layers.0.strokes.1.d", [1] * count))
    assert said == f"has {count} numbers; a chain of cubics has 2 + 6k - at `$.layers[0].strokes[1].d`"


@pytest.mark.parametrize("key", ["pressure", "angle"])
@pytest.mark.parametrize("values", [[], [0.5], [0.5] * 3])
def test_pressure_and_angle_must_be_given_at_every_on_curve_point(key: str, values: list[float]) -> None:
    said = fault(edited(f"layers.1.strokes.0.{key}", values))
    assert said == f"has {len(values)} values; one per on-curve point is wanted - at `$.layers[1].strokes[0].{key}`"


def test_a_fault_is_counted_within_its_layer() -> None:
    assert fault(edited("layers.1.strokes.0.d", [1] * 9)).endswith("at `$.layers[1].strokes[0].d`")


@pytest.mark.parametrize("literal", ["NaN", "Infinity", "-Infinity", "0x10", "1.", "01", "+1"])
@pytest.mark.parametrize("path", ["layers.0.strokes.1.d.2", "layers.0.strokes.1.width", "settings.seed"])
def test_a_number_that_is_not_json_is_refused_with_its_place(path: str, literal: str) -> None:
    data = with_literal(path, literal)
    place = re.fullmatch(r"JSON is malformed: .* \(byte (\d+)\)", fault(data))
    assert place
    assert abs(int(place[1]) - data.index(literal.encode())) <= len(literal)


@pytest.mark.parametrize("literal", ["1e999", "-1e999", "1" + 400 * "0"])
@pytest.mark.parametrize("path", ["layers.0.strokes.1.d.2", "layers.0.strokes.1.width", "canvas.width"])
def test_a_number_too_large_for_a_double_is_refused_with_its_path(path: str, literal: str) -> None:
    said = fault(with_literal(path, literal))
    assert "out of range" in said
    assert said.split("at `$.")[1].startswith(path.split(".")[0])


def test_an_integer_of_thousands_of_digits_in_settings_is_refused() -> None:
    assert "out of range" in fault(with_literal("settings.seed", "1" * 5000))


# Versions and formats


def newer(document: dict[str, Any]) -> dict[str, Any]:
    return {**document, "version": 2, "brushes": ["future"]}


@pytest.mark.parametrize(
    "write",
    [
        lambda d: json.dumps(newer(d), separators=(",", ":")),
        lambda d: json.dumps(newer(d), indent=4),
        lambda d: "\n\n\t " + json.dumps(newer(d)),
        lambda d: json.dumps(dict(reversed(newer(d).items()))),
        lambda d: json.dumps({"layers": "of another kind", "version": 2, "format": "strokeplan"}),
    ],
    ids=["compact", "indented", "after whitespace", "version last", "of another structure"],
)
def test_a_newer_version_is_refused_by_name(write: Callable[[dict[str, Any]], str]) -> None:
    said = fault(write(json.loads(GOLDEN.read_bytes())).encode())
    assert said == "is of version 2; this strokeplan reads up to version 1: update it"


@pytest.mark.parametrize("name", ["svg", "", "Strokeplan"])
def test_another_format_is_refused_by_name(name: str) -> None:
    assert fault(edited("format", name)) == f"is not a strokes file: \"format\" is '{name}', not 'strokeplan'"


def test_json_without_a_format_is_refused() -> None:
    assert fault(b'{"type": "FeatureCollection"}').startswith("is not a strokes file")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "Input data was truncated"),
        (b"null", "Expected `object`, got `null`"),
        (b"[1, 2]", "Expected `object`, got `array`"),
        (b"<svg/>", "JSON is malformed: invalid character (byte 0)"),
        (b"\xef\xbb\xbf{}", "JSON is malformed: invalid character (byte 0)"),
        (GOLDEN.read_text(encoding="utf-8").encode("utf-16"), "JSON is malformed: invalid character (byte 0)"),
        (gzip.compress(GOLDEN.read_bytes()), "JSON is malformed: invalid character (byte 0)"),
        (b"{} {}", "JSON is malformed: trailing characters"),
    ],
    ids=["empty", "null", "array", "svg", "byte order mark", "utf-16", "gzip", "trailing"],
)
def test_what_is_no_strokes_file_is_refused(data: bytes, message: str) -> None:
    assert fault(data).startswith(message)


def test_text_that_is_not_utf_8_is_refused_with_its_place() -> None:
    data = GOLDEN.read_bytes().replace(b"by hand", "bé hand".encode("latin-1"))
    assert fault(data) == f"is not UTF-8 (byte {data.index(0xE9)})"


def test_every_truncation_is_refused() -> None:
    whole = GOLDEN.read_bytes().rstrip()
    for end in range(len(whole)):
        fault(whole[:end])


@pytest.mark.parametrize("brackets", ["[" * 100_000 + "]" * 100_000, '{"a":' * 100_000 + "1" + "}" * 100_000])
@pytest.mark.parametrize("path", ["settings.preset", "layers.0.strokes.0.note", "note"])
def test_deep_nesting_is_refused(path: str, brackets: str) -> None:
    said = fault(with_literal(path, brackets))
    assert said == "is nested too deeply" or "unknown field `note`" in said


def test_of_two_equal_keys_the_last_counts() -> None:
    golden = GOLDEN.read_bytes()
    twice = golden.replace(b'"width":0.5,', b'"width":7,"width":0.5,').replace(b'"seed":7', b'"seed":1,"seed":7')
    assert_same(decode(twice), TINY)


def test_of_two_equal_keys_both_must_be_valid() -> None:
    assert "`$.canvas.width`" in fault(GOLDEN.read_bytes().replace(b'"width":20.0', b'"width":0,"width":20.0'))


TOKENS = [b"NaN", b"1e999", b"-", b"null", b"{", b"]", b'"', b"\\", b"\\ud800", b"\x00", b"\xff", b",", b"1" * 5000]
EDITS = st.lists(
    st.tuples(st.integers(0, 2000), st.integers(0, 12), st.sampled_from(TOKENS) | st.binary(max_size=4)),
    min_size=1,
    max_size=4,
)


@given(plans(), EDITS)
def test_a_damaged_file_is_a_plan_or_a_format_error(plan: StrokePlan, edits: list[tuple[int, int, bytes]]) -> None:
    data = encode(plan)
    for at, cut, token in edits:
        at %= len(data) + 1
        data = data[:at] + token + data[at + cut :]
    try:
        again = decode(data)
    except FormatError:
        return
    assert_same(decode(encode(again)), again)


# Files


def test_a_missing_file_a_folder_and_another_suffix_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "folder.json").mkdir()
    for name, message in {
        "none.json": "no such file",
        "folder.json": "is a folder; give a strokes file",
        "plan.txt": "not a strokes file by its suffix; readable are .json, .json.gz, .svg, .svgz",
    }.items():
        with pytest.raises(FormatError) as caught:
            strokeplan.load(tmp_path / name)
        assert str(caught.value) == f"{tmp_path / name}: {message}"


def test_a_fault_in_a_file_is_told_with_the_file_s_name(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(edited("canvas.width", 0))
    with pytest.raises(FormatError, match=r"a\.json: Expected .* at `\$\.canvas\.width`"):
        strokeplan.load(tmp_path / "a.json")


@pytest.mark.parametrize(
    "damage",
    [
        lambda packed: packed[:-9],
        lambda packed: packed[:40],
        lambda packed: b"",
        lambda packed: packed[:20] + bytes(byte ^ 255 for byte in packed[20:40]) + packed[40:],
        lambda packed: packed[:-8] + bytes(4) + packed[-4:],
        lambda packed: packed + b"more",
        lambda packed: GOLDEN.read_bytes(),
    ],
    ids=["trailer cut", "cut", "empty", "garbled", "wrong checksum", "trailing", "not gzip"],
)
def test_a_damaged_gzip_file_is_refused(damage: Callable[[bytes], bytes], tmp_path: Path) -> None:
    (tmp_path / "a.json.gz").write_bytes(damage(gzip.compress(GOLDEN.read_bytes())))
    with pytest.raises(FormatError, match=r"a\.json\.gz: "):
        strokeplan.load(tmp_path / "a.json.gz")


def test_a_gzip_bomb_stops_at_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.json.gz").write_bytes(gzip.compress(bytes(50 << 20), compresslevel=1))
    monkeypatch.setattr("strokeplan.formats.json.MAX_BYTES", 1 << 20)
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match="holds more than 1 MB"):
            strokeplan.load(tmp_path / "a.json.gz")
        assert tracemalloc.get_traced_memory()[1] < 10 << 20
    finally:
        tracemalloc.stop()


def test_a_packed_file_has_no_time_stamp(tmp_path: Path) -> None:
    TINY.save(tmp_path / "a.json.gz")
    packed = (tmp_path / "a.json.gz").read_bytes()
    assert packed[4:8] == bytes(4)
    assert gzip.decompress(packed) == encode(TINY)


# The document


def test_the_example_in_the_document_is_a_strokes_file(tmp_path: Path) -> None:
    (example,) = re.findall(r"```json\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "example.json").write_text(example, encoding="utf-8")
    assert validate([tmp_path / "example.json"])["status"] == "ok"
    plan = strokeplan.load(tmp_path / "example.json")
    assert (len(plan), plan.cubics, [layer.name for layer in plan.layers]) == (2, 3, ["1", "outlines"])


def test_the_document_names_every_field() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    fields = {name for part in schema()["$defs"].values() for name in part["properties"]}
    assert {name for name in fields if f"`{name}`" not in text} == set()
