"""What is plugged in: recognised by its USB ids, or by asking.

Ids tell an EiBotBoard for certain; of other machines they tell the chip that makes a serial port of the USB, and which
machines have such chips. What is there for certain only the machine can say: `ask` opens the port, which starts boards
of the Arduino kind anew (DTR), listens for a banner and puts harmless questions, one protocol's after the other.

Sources of the ids: plotink (EiBotBoard), PlatformIO's udev rules and OpenBlock's list of common hardware ids (chips,
Arduino, Raspberry Pi Pico), uArm's Python SDK (2341:0042), espflash's udev rules (Espressif), usb.ids (ST's 5740).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from strokeplan.errors import DriveError, InputError, PlotError
from strokeplan.plotter.driving.codec import recognise
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.transport import Transport, require_serial
from strokeplan.plotter.profile import Ebb, Hpgl, Profile

AUTO = "auto"
ANY = ("GRBL", "Marlin", "uArm", "HP-GL")
"""What speaks through a chip that anyone may buy."""
BOARDS = ("GRBL", "Marlin", "uArm")
IDS: dict[tuple[int, int | None], tuple[str, tuple[str, ...]]] = {
    (0x04D8, 0xFD92): ("EiBotBoard", ("EBB",)),
    (0x1A86, 0x7523): ("CH340", ANY),
    (0x1A86, 0x55D4): ("CH9102", ANY),
    (0x0403, 0x6001): ("FT232", ANY),
    (0x0403, 0x6015): ("FT231X", ANY),
    (0x10C4, 0xEA60): ("CP210x", ANY),
    (0x067B, 0x2303): ("PL2303", ANY),
    (0x2341, 0x0042): ("Arduino Mega 2560, uArm Swift", BOARDS),
    (0x2341, None): ("Arduino", BOARDS),
    (0x2A03, None): ("Arduino", BOARDS),
    (0x0483, 0x5740): ("STM32", ("GRBL", "Marlin")),
    (0x2E8A, 0x0005): ("Raspberry Pi Pico", ("GRBL", "Marlin")),
    (0x2E8A, 0x000A): ("Raspberry Pi Pico", ("GRBL", "Marlin")),
    (0x303A, 0x1001): ("ESP32", ("GRBL",)),
}
"""(vendor, product or None for all of the vendor's) → what it is, and the protocols that it may speak."""
LISTEN_S = 2.5
"""A board that was started anew has said its banner by then."""
ANSWER_S = 0.8
QUESTIONS = (b"V\r", b"\n$I\n", b"\nM115\n", b"#1 P2203\n")
"""EBB, GRBL, Marlin, uArm: each harmless to the others, which answer that they do not know it."""
PLOTTER_BAUD = 9600
_MODEL = re.compile(r"(?=.*\d)[A-Z0-9][A-Z0-9-]{2,11}")


@dataclass(frozen=True, slots=True)
class Port:
    """A serial port of this computer.

    chip      what its USB ids say that it is; "" for ids that are not known, or none.
    families  the protocols that it may speak, by the names of their codecs; () for all that one knows.
    """

    device: str
    description: str
    ids: str
    chip: str
    families: tuple[str, ...]

    def describe(self) -> str:
        """In one line, for people."""
        known = f"{self.chip}: {' or '.join(self.families)}" if self.chip else "not known"
        text = f"{self.ids} {known}" if self.ids else known
        told = self.description not in ("", "n/a", self.chip)
        return f"{text} ({self.description})" if told else text


def plugged_in() -> list[Port]:
    """The serial ports of this computer, by name. Raises MissingExtraError without pyserial."""
    require_serial()
    from serial.tools.list_ports import comports

    return recognised(comports())


def recognised(found: Iterable[object]) -> list[Port]:
    """pyserial's list of ports, by name, with what their ids tell."""
    return sorted(map(_port, found), key=lambda port: port.device)


def _port(found: object) -> Port:
    vendor, product = getattr(found, "vid", None), getattr(found, "pid", None)
    text = " ".join(str(getattr(found, "description", "") or "").split())[:60]
    plain = "".join(c for c in text if c.isprintable())
    known = None if vendor is None else IDS.get((vendor, product)) or IDS.get((vendor, None))
    if known is None and plain.startswith("EiBotBoard"):  # a name that its owner gave it keeps this beginning
        known = IDS[0x04D8, 0xFD92]
    ids = "" if vendor is None else f"{vendor:04X}:{product or 0:04X}"
    return Port(str(getattr(found, "device", "")), plain, ids, *(known or ("", ())))


def family(profile: Profile) -> str:
    """The protocol of a profile's machines, by the name of its codec. Raises PlotError for files only."""
    dialect = profile.dialect
    if isinstance(dialect, Hpgl):
        return "HP-GL"
    if isinstance(dialect, Ebb):
        return "EBB"
    found = {"marlin": "Marlin", "uarm": "uArm", "linuxcnc": ""}.get(dialect.flavour, "GRBL")
    if not found:
        raise PlotError(f"profile {profile.name}: {dialect.flavour} cannot be driven over a port; export a file for it")
    return found


def chosen(port: str, profile: Profile, ports: Callable[[], Sequence[Port]] | None = None) -> str:
    """`port` itself, or for "auto" the one that fits the profile.

    Raises InputError where none fits or more than one, which names them.
    """
    if port != AUTO:
        return port
    wanted = family(profile)
    found = (ports or plugged_in)()
    fitting = [one for one in found if wanted in one.families]
    if len(fitting) == 1:
        return fitting[0].device
    if fitting:
        names = ", ".join(f"{one.device} ({one.chip})" for one in fitting)
        raise InputError(
            f"--port auto: {len(fitting)} ports may be {profile.name} ({wanted}): {names}; name one of them"
        )
    others = ", ".join(f"{one.device} ({one.chip or one.ids or 'no USB ids'})" for one in found) or "nothing"
    raise InputError(
        f"--port auto: no port looks like {profile.name} ({wanted}); plugged in: {others}; give --port PORT"
    )


def ask(open_at: Callable[[int], Transport]) -> tuple[str, str] | None:
    """The protocol and what the machine said of itself; None for one that says nothing that is known.

    open_at   opens the port at a baud rate; it is closed again. Raises DriveError where it cannot be opened.
    """
    found = _asked(open_at(115200), _board)
    return found or _asked(open_at(PLOTTER_BAUD), _pen_plotter)


def keep_awake(transport: Transport, *, awake: bool = True) -> None:
    """Keep DTR up when the port is closed (POSIX), so that the next opening does not start the machine anew.

    What the machine knows of its place is kept from one set-up command to the next, and to the drawing; that one lets
    the line drop again (awake=False), so that whoever resumes after a crash finds the machine as it is told to be: at
    its zero. The very first opening after plugging in resets all the same.
    """
    descriptor = getattr(transport, "descriptor", None)
    try:
        import termios
    except ImportError:  # Windows
        return
    if descriptor is not None:
        with suppress(termios.error):  # a socket
            attributes = termios.tcgetattr(descriptor)
            attributes[2] = attributes[2] & ~termios.HUPCL | (0 if awake else termios.HUPCL)
            termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def _asked(transport: Transport, how: Callable[[Link], tuple[str, str] | None]) -> tuple[str, str] | None:
    try:
        return how(Link(transport))
    except DriveError as error:
        raise DriveError(f"asked, and then: {error}") from None
    finally:
        transport.close()


def _board(link: Link) -> tuple[str, str] | None:
    found = link.hear(_recognised, LISTEN_S)
    for question in QUESTIONS:
        if found is not None:
            break
        link.drain(0.1, 1.0)
        link.push(question)
        found = link.hear(_recognised, ANSWER_S)
    if found is not None:
        link.drain(0.2, 1.0)
    return found


def _recognised(line: str) -> tuple[str, str] | None:
    name = recognise(line)
    return None if name is None else (name, _plain(line))


def _pen_plotter(link: Link) -> tuple[str, str] | None:
    """OI; asks an HP-GL plotter for its model."""
    link.drain(0.1, 1.0)
    link.push(b"OI;")
    return link.hear(lambda line: ("HP-GL", line) if _MODEL.fullmatch(line) else None, 1.5)


def _plain(line: str) -> str:
    return "".join(c if " " <= c <= "~" else "?" for c in line)[:70]
