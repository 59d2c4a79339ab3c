"""Pictures of strokeplan in other programs: python benchmarks/ecosystem.py

Writes docs/ecosystem/vpype.jpg and docs/ecosystem/inkscape.jpg from samples/. Needs the extra `vpype`, inkex
(pip install --no-deps inkex lxml cssselect tinycss2) and rsvg-convert.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from strokeplan.figures import side_by_side
from strokeplan.formats import write
from strokeplan.inkscape import install

ROOT = Path(__file__).parent.parent
PICTURES = ROOT / "docs" / "ecosystem"
WIDTH_PX, QUALITY = 900, 75
VPYPE = "strokeplan samples/coffee.jpg --preset sketch --palette 5 --width 18cm linemerge linesort write"
"""The picture shows the file that this writes."""
PAGE = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
 xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" width="130" height="110" viewBox="0 0 130 110">
<g inkscape:groupmode="layer" transform="rotate(-6)"><image id="image1" x="5" y="18" width="108" height="78"
 preserveAspectRatio="xMidYMid slice" xlink:href="{photo}"/></g></svg>"""


def main() -> None:
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _save("vpype.jpg", _through_vpype(folder))
        _save("inkscape.jpg", _through_extension(folder))


def _through_vpype(folder: Path) -> NDArray[np.uint8]:
    out = folder / "vpype.svg"
    subprocess.run([sys.executable, "-m", "vpype_cli", *VPYPE.split(), str(out)], check=True, cwd=ROOT)
    return _rendered(out, WIDTH_PX)


def _through_extension(folder: Path) -> NDArray[np.uint8]:
    """A page before and after."""
    script = install(folder / "extensions")[1]
    before, after = folder / "before.svg", folder / "after.svg"
    before.write_text(PAGE.format(photo=(ROOT / "samples" / "astronaut.jpg").as_uri()))
    words = ["--id=image1", "--preset=impressionist", f"--output={after}", str(before)]
    subprocess.run([sys.executable, str(script), *words], check=True)
    # librsvg reads no file from another folder.
    before.write_text(PAGE.format(photo="astronaut.jpg"))
    (folder / "astronaut.jpg").write_bytes((ROOT / "samples" / "astronaut.jpg").read_bytes())
    return side_by_side([_rendered(page, WIDTH_PX // 2) for page in (before, after)])


def _rendered(svg: Path, width: int) -> NDArray[np.uint8]:
    command = ["rsvg-convert", "--unlimited", "-b", "white", "-w", str(2 * width), str(svg)]
    png = subprocess.run(command, check=True, capture_output=True).stdout
    with Image.open(io.BytesIO(png)) as shown:
        return np.asarray(shown.convert("RGB").reduce(2))


def _save(name: str, picture: NDArray[np.uint8]) -> None:
    data = io.BytesIO()
    Image.fromarray(picture).save(data, "JPEG", quality=QUALITY, optimize=True)
    write(PICTURES / name, data.getvalue())
    print(f"{PICTURES / name}: {len(data.getvalue()) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
