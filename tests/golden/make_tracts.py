"""Make tracts.json anew: 200 tracts of the sample photos with their fitted chains.

Only for a change of the fit that is meant: python tests/golden/make_tracts.py
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from strokeplan.curves import fit_tract
from strokeplan.field import orientation_field
from strokeplan.image import grey, load_photo
from strokeplan.tractography import track

HERE = Path(__file__).parent


def main() -> None:
    rng = np.random.default_rng(2)
    entries = []
    for name in ("astronaut", "coffee"):
        photo = load_photo(HERE.parent.parent / "samples" / f"{name}.jpg")
        for sigma, length in ((5, 200), (1, 100)):
            field = orientation_field(grey(photo.rgb), sigma=sigma)
            found = 0
            while found < 50:
                seed = tuple(rng.random(2) * (photo.width, photo.height))
                points = np.round(track(field, seed, max_length=length), 3)
                if len(points) > 3:
                    chain = np.round(fit_tract(points), 3)
                    entries.append({"points": points.tolist(), "chain": chain.tolist()})
                    found += 1
    lines = ",\n".join(json.dumps(entry, separators=(",", ":")) for entry in entries)
    (HERE / "tracts.json").write_text(f"[\n{lines}\n]\n")


if __name__ == "__main__":
    main()
