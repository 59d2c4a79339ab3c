"""What a preset may say about colour. Data only, apart from palette.py, so that presets load without numpy.

The two tables can stand alone, or be bases of a preset and of its layers.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

MAX_COLORS = 256
"""Most colours of a palette."""
HexColor = Annotated[str, Meta(pattern="^#[0-9a-fA-F]{6}$", max_length=7)]  # "$" alone would let a newline follow


class ColorStyle(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The colours that a whole plan is limited to: those of a list, or some of the photo's own.

    Raises ValueError (msgspec: ValidationError) if both are asked for.
    """

    palette: Annotated[tuple[HexColor, ...], Meta(max_length=MAX_COLORS)] = ()
    """The only colours of the strokes; none: any colour."""
    palette_size: Annotated[int, Meta(ge=0, le=MAX_COLORS)] = 0
    """How many colours to take from the photo; 0: no limit."""

    def __post_init__(self) -> None:
        if self.palette and self.palette_size:
            raise ValueError(
                f"a palette of {len(self.palette)} colours and palette_size = {self.palette_size} exclude each other;"
                " give palette = [] or palette_size = 0"
            )


class LayerColors(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the strokes of a layer depart from the photo's colours, in CIE L*C*h(ab).

    A shift is the same for all strokes of the layer; a jitter is drawn for each (Hertzmann 1998, section 3.1:
    random colour factors), normal with mean 0 and the standard deviation given here.
    """

    hue_shift: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    """Added to the hue angle, degrees."""
    chroma_shift: Annotated[float, Meta(ge=0, le=10)] = 1.0
    """Factor of the chroma: 0 is grey."""
    lightness_shift: Annotated[float, Meta(ge=-100, le=100)] = 0.0
    """Added to L*, which runs from 0 to 100."""
    hue_jitter: Annotated[float, Meta(ge=0, le=180)] = 0.0
    """Degrees."""
    chroma_jitter: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Part of the stroke's own chroma."""
    lightness_jitter: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """In L*."""
