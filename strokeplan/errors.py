"""What can go wrong, and the exit code each kind ends the command line with.

    StrokeplanError            anything this package raises on purpose          1
    ├── InputError             the caller's file, value or option is wrong      2
    │   ├── ImageError         a photo that cannot be read or planned           2
    │   ├── PresetError        a preset, or a value set in one                  2
    │   ├── ProfileError       a machine profile                                2
    │   ├── PlotError          a drawing that the machine cannot take           2
    │   └── FormatError        a strokes file, or a suffix nobody handles       2
    ├── DriveError             a machine that did not do as it was told         1
    │   └── DeviceLost         a port that went away                            1
    ├── MissingExtraError      an optional package is not installed             2
    └── OutputError            the result could not be written                  2

Every message is one line that names the value, where it stands and what would be right.
"""

from __future__ import annotations


class StrokeplanError(Exception):
    """Base of every error that strokeplan raises on purpose."""

    exit_code = 1


class InputError(StrokeplanError):
    """Something the caller handed in is wrong."""

    exit_code = 2


class ImageError(InputError):
    """A photo that cannot be read, or cannot be planned."""


class PresetError(InputError):
    """A preset that is unknown or malformed, or a value out of range."""


class ProfileError(InputError):
    """A machine profile that is unknown or malformed."""


class PlotError(InputError):
    """A drawing that does not fit the machine, its pens or its paper."""


class FormatError(InputError):
    """A strokes file that is malformed, or a suffix that no format handles."""


class DriveError(StrokeplanError):
    """A machine that did not do as it was told: what was drawn until then stays in the journal."""


class DeviceLost(DriveError):  # noqa: N818 - what happened, in the word that everyone uses
    """The port went away: unplugged, switched off, or closed by the other side."""


class MissingExtraError(StrokeplanError):
    """An optional dependency is needed and not installed; the message says how to get it."""

    exit_code = 2


class OutputError(StrokeplanError):
    """A result that could not be written; whatever stood there before is untouched."""

    exit_code = 2


class StrokeplanWarning(UserWarning):
    """Something was decided on the caller's behalf (a colour depth cut, a broken profile ignored)."""
