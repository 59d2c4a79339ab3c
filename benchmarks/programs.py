"""What other programs show of our SVG, and how large it is beside vtracer's: python benchmarks/programs.py

Rewrites the tables of docs/svg.md between its marks: PSNR of each program's picture against `strokeplan render` at
twice the size, with the CPU seconds that it took, and bytes and PSNR against the photo of strokeplan and vtracer at
their defaults. Needs rsvg-convert, inkscape, chromium, resvg-py and vtracer; a program that is not there, or not done
within LIMIT_S, is told as that.
"""

from __future__ import annotations

import io
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import strokeplan
from strokeplan import ExportOptions
from strokeplan.formats import compress, write
from strokeplan.formats.svg import encode
from strokeplan.rendering import render

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "svg.md"
SAMPLES = ("chelsea", "coffee", "astronaut")
SCALE, LIMIT_S = 2, 300
PRESSED = {"pressure": 0.5}
Picture = NDArray[np.float64]


def main() -> None:
    text = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        text = _between(text, "programs", _programs(Path(folder)))
        text = _between(text, "sizes", _sizes(Path(folder)))
    write(PAGE, text.encode())


def _between(text: str, name: str, lines: Iterator[str]) -> str:
    """The page with a table between the marks of its name."""
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->\n"
    before, _, rest = text.partition(begin)
    return before + begin + "\n".join(lines) + "\n" + end + rest.partition(end)[2]


# The picture in other programs


def _programs(folder: Path) -> Iterator[str]:
    photo = ROOT / "samples" / "chelsea.jpg"
    plan = strokeplan.plan(photo)
    pressed = strokeplan.plan(photo, strokeplan.load_preset("fine").override(PRESSED))
    yield "| file | MB | " + " | ".join(PAINTERS) + " |"
    yield "|---|---|" + "---|" * len(PAINTERS)
    outline, classes = ExportOptions(outline=True), ExportOptions(classes=True)
    for name, shown, options in (
        ("default", plan, ExportOptions()),
        ("`--classes`", plan, classes),
        ("`--outline`", plan, outline),
        ("`--set pressure=0.5`", pressed, ExportOptions()),
    ):
        data, own = encode(shown, options), render(shown, scale=SCALE).astype(float)
        cells = " | ".join(_cell(painter, data, own, folder) for painter in PAINTERS.values())
        yield f"| {name} | {len(data) / 1e6:.2f} | {cells} |"


def _cell(painter: Callable[[Path, int, int], bytes], data: bytes, own: Picture, folder: Path) -> str:
    """PSNR and CPU seconds."""
    file = folder / "a.svg"
    file.write_bytes(data)
    before = _cpu_s()
    try:
        shown = _pixels(painter(file, own.shape[1], own.shape[0]))
    except FileNotFoundError:
        return "not installed"
    except subprocess.TimeoutExpired:
        return f"not done in {LIMIT_S} s"
    return f"{_psnr(shown[: own.shape[0], : own.shape[1]], own)} ({_cpu_s() - before:.1f} s)"


def _cpu_s() -> float:
    """Of this process and of all that it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _run(program: str, *words: str) -> bytes:
    if shutil.which(program) is None:
        raise FileNotFoundError(program)
    return subprocess.run([program, *words], capture_output=True, check=True, timeout=LIMIT_S).stdout


def _rsvg(file: Path, width: int, _: int) -> bytes:
    return _run("rsvg-convert", "--unlimited", "-w", str(width), str(file))


def _inkscape(file: Path, width: int, _: int) -> bytes:
    _run("inkscape", str(file), "-w", str(width), "-o", str(file.with_suffix(".png")))
    return file.with_suffix(".png").read_bytes()


def _resvg(file: Path, _: int, __: int) -> bytes:
    import resvg_py

    return bytes(resvg_py.svg_to_bytes(svg_string=file.read_text(), skip_system_fonts=True, zoom=SCALE))


def _chromium(file: Path, width: int, height: int) -> bytes:
    page, png = file.with_suffix(".html"), file.with_suffix(".png")
    page.write_text(f'<body style="margin:0"><img style="display:block" width={width} height={height} src={file.name}>')
    size = f"--window-size={width},{height}"
    _run("chromium", "--headless", "--no-sandbox", "--hide-scrollbars", size, f"--screenshot={png}", page.as_uri())
    return png.read_bytes()


PAINTERS = {"rsvg-convert": _rsvg, "Inkscape": _inkscape, "resvg": _resvg, "Chromium": _chromium}


def _pixels(png: bytes) -> Picture:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)


def _psnr(a: Picture, b: Picture) -> str:
    error = float(np.mean((a - b) ** 2))
    return "identical" if error == 0 else f"{10 * np.log10(255**2 / error):.1f} dB"


# The size beside vtracer's


def _sizes(folder: Path) -> Iterator[str]:
    yield "| photo | vtracer | strokeplan |"
    yield "|---|---|---|"
    for name in SAMPLES:
        photo = ROOT / "samples" / f"{name}.jpg"
        traced, plan = _traced(photo), strokeplan.plan(photo)
        cells = " | ".join(_size(data, photo, folder) for data in (traced, encode(plan)))
        yield f"| `samples/{name}.jpg` | {cells} |"


def _traced(photo: Path) -> bytes:
    import vtracer

    return str(vtracer.convert_raw_image_to_svg(photo.read_bytes(), img_format="jpg")).encode()


def _size(data: bytes, photo: Path, folder: Path) -> str:
    file = folder / "a.svg"
    file.write_bytes(data)
    own = np.asarray(Image.open(photo).convert("RGB"), float)
    shown = _pixels(_rsvg(file, own.shape[1], 0))
    packed = compress(data)
    return f"{len(data) / 1e6:.2f} MB (gzip {len(packed) / 1e6:.2f} MB), {_psnr(shown, own)}"


if __name__ == "__main__":
    main()
