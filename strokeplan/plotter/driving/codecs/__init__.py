"""One codec a protocol; `codec_for` finds that of a profile."""

from __future__ import annotations

from strokeplan.errors import PlotError
from strokeplan.plotter.driving.codec import Codec, Phrases
from strokeplan.plotter.profile import Ebb, Gcode, Hpgl, Profile


def codec_for(profile: Profile, phrases: Phrases) -> Codec:
    """The codec of a profile's dialect and flavour. Raises PlotError for one that is for files only."""
    from strokeplan.plotter.driving.codecs.ebb import EbbCodec
    from strokeplan.plotter.driving.codecs.grbl import FLAVOURS, GrblCodec
    from strokeplan.plotter.driving.codecs.hpgl import HpglCodec
    from strokeplan.plotter.driving.codecs.marlin import MarlinCodec
    from strokeplan.plotter.driving.codecs.uarm import UarmCodec

    dialect = profile.dialect
    if isinstance(dialect, Gcode) and dialect.flavour in FLAVOURS:
        return GrblCodec(phrases, profile)
    if isinstance(dialect, Gcode) and dialect.flavour == "marlin":
        return MarlinCodec(phrases, profile)
    if isinstance(dialect, Gcode) and dialect.flavour == "uarm":
        return UarmCodec(phrases)
    if isinstance(dialect, Hpgl):
        return HpglCodec(phrases, dialect.buffer_bytes)
    if isinstance(dialect, Ebb):
        return EbbCodec(phrases)
    kind = dialect.flavour if isinstance(dialect, Gcode) else type(dialect).__name__.lower()
    raise PlotError(f"profile {profile.name}: {kind} cannot be driven over a port; export a file for it")


def baud_of(profile: Profile) -> int:
    """What the dialect's machines are set to when they come: pen plotters of old 9600, others 115200."""
    return 9600 if isinstance(profile.dialect, Hpgl) else 115200
