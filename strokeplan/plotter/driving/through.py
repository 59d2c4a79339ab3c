"""A short exchange with a codec that streams: some commands and a fence, waited for."""

from __future__ import annotations

from strokeplan.errors import DriveError
from strokeplan.plotter.driving.codec import Codec, Fault, Fence, Fenced, Item
from strokeplan.plotter.driving.link import LOOK_S, Emergency, Link

MOST_S = 300.0
"""Nothing that is said between strokes takes so long: someone paused the machine."""


def through(codec: Codec, link: Link, commands: tuple[str, ...], most_s: float = MOST_S) -> None:
    """Have commands carried out while nothing else is under way. Raises DriveError for any fault, Emergency."""
    items: list[Item] = [*commands, Fence(0)]
    until = link.now() + most_s
    while True:
        now = link.now()
        while items and codec.take(items[0], now):
            items.pop(0)
        link.push(codec.outgoing(now))
        data = link.read(min(codec.wait_s(now), LOOK_S))
        now = link.now()
        events = codec.feed(data, now) if data else []
        for event in (*events, *codec.overdue(now)):
            if isinstance(event, Fault):
                raise DriveError(event.text)
            if isinstance(event, Fenced):
                return
        if link.emergency():
            raise Emergency
        if now > until:
            raise DriveError(f"the machine does not come to an end in {most_s:g} s: is it paused?")
