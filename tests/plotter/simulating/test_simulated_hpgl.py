"""Simulated pen plotters against HP's manuals: buffers, handshakes, outputs, limits."""

from __future__ import annotations

import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import need_program
from hosts import Host
from hypothesis import given, settings
from hypothesis import strategies as st
from readers import distance

from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.simulating.hpgl import XOFF, XON
from strokeplan.plotter.simulating.port import SimulatedPort

UNIT = 0.02488


@pytest.mark.parametrize(
    ("sent", "reply"),
    [
        ("\x1b.B", "1024\r"), ("\x1b.L", "1024\r"), ("\x1b.O", "8\r"), ("\x1b.E", "0\r"), ("IN;OI;", "7475A\r"),
        ("OS;", "24\r"), ("IN;OE;", "0\r"), ("XX;OE;OE;", "1\r0\r"), ("SP9;OE;", "3\r"), ("PA1;OE;", "2\r"),
        ("OH;", "0,0,16158,11040\r"), ("PU100,200;OA;", "100,200,0\r"), ("\x1bx\x1b.E", "11\r"),
        ("\x1b.@;1x\x1b.E", "12\r"),
        ("SP1;PU50,50;PR10,0,0,10;OA;", "60,60,0\r"),
    ],
)  # fmt: skip
def test_replies(sent: str, reply: str) -> None:
    assert Host("hp7475a").ask(sent, 5.0) == reply


def test_overflow_is_silent_and_only_the_error_tells() -> None:
    host = Host("hp7475a")
    host.ask("SP1;PU0,0;", 3.0)
    said = host.ask("PD" + "9000,9000,100,100," * 150 + "0,0;", 4.0)
    assert said == ""
    assert host.device.lost > 100
    assert host.ask("\x1b.E\x1b.E", 0.1) == "16\r0\r"


def test_an_empty_buffer_is_not_the_end_of_drawing() -> None:
    """ESC.O says 8 while the last vector is still drawn; OA answers when it is done."""
    host = Host("hp7475a")
    host.ask("SP1;PU0,0;", 3.0)
    host.ask("VS1;PD2000,0;", 0.5)
    assert host.ask("\x1b.O", 0.1) == "8\r"
    assert host.ask("OA;", 1.0) == ""
    assert host.hear(10.0) == "2000,0,1\r"


def test_xon_xoff() -> None:
    host = Host("hp7475a")
    host.ask("SP1;PU0,0;\x1b.I81;;17:\x1b.N;19:", 3.0)
    waiting, said, ready = b"PD" + b"4000,0,0,0," * 150 + b"0,0;PU;", "", True
    while waiting:
        if ready:
            host.port.write(waiting[:20])
            waiting = waiting[20:]
        said += host.hear(0.05)
        ready = not said.endswith(chr(XOFF))
    assert said.startswith(chr(XOFF) + chr(XON))
    assert host.device.lost == 0
    assert host.ask("OA;", 600.0).endswith("0,0,0\r")


def test_hardwire_handshake_stops_the_wire() -> None:
    host = Host("hp7475a")
    host.port = SimulatedPort(host.device, 9600, host.port.now(), rtscts=True)
    host.ask("\x1b.@;1:SP1;PU0,0;", 3.0)
    host.ask("PD" + "4000,0,0,0," * 200 + "0,0;PU;", 3.0)
    assert not host.device.clear_to_send
    assert "0,0,0" in host.ask("OA;", 600.0)
    assert host.device.lost == 0


def test_view_lifts_the_pen_and_a_second_time_it_goes_on() -> None:
    host = Host("hp7475a")
    host.ask("SP1;PU0,0;VS2;PD2000,0,2000,2000;", 4.0)
    assert host.device.pen_down
    host.device.press(host.port.now())
    assert host.device.pen_down  # the vector is drawn to its end
    host.hear(5.0)
    assert not host.device.pen_down
    assert host.device.place_mm == pytest.approx((2000 * UNIT, 0))
    assert host.ask("\x1b.O", 0.5) in ("16\r", "24\r")
    host.device.press(host.port.now())
    assert host.device.pen_down
    host.ask("PU;", 10.0)
    assert host.device.place_mm == pytest.approx((2000 * UNIT, 2000 * UNIT))


def test_nothing_is_drawn_beyond_the_limits() -> None:
    host = Host("hp7475a")
    host.ask("SP1;PU500,500;PD-1000,500,-1000,1000,500,1000;PU;", 10.0)
    points = np.concatenate(host.device.drawn.lines) / UNIT
    assert points.min() >= 0
    assert len(host.device.drawn) == 2
    assert host.device.drawn.length_mm == pytest.approx(1000 * UNIT)


def test_pens_are_fetched_and_without_one_nothing_is_drawn() -> None:
    host = Host("hp7475a")
    host.ask("PU0,0;PD100,0;SP2;PD200,0;SP4;PD300,0;SP0;PD400,0;PU;", 20.0)
    assert host.device.drawn.slots == (2, 4)


def test_the_7470a_has_a_small_buffer_and_lifts_a_pen_that_rests() -> None:
    host = Host("hp7470a")
    assert host.ask("\x1b.B", 0.5) == "255\r"
    host.ask("SP1;PU0,0;PD100,0;", 5.0)
    assert host.device.pen_down
    host.hear(60.0)
    assert not host.device.pen_down


def test_hp2xx_reads_the_same_lines(tmp_path: Path) -> None:
    """hp2xx, which shares nothing with the simulator, draws what the simulator drew (its Gnuplot output)."""
    program = need_program("hp2xx")
    text = "IN;SP1;PU400,400;PD2400,400,2400,1400;PU;PR-400,200;PD-600,0;PA;PU3000,3000;PD3000,100;PU;SP0;"
    host = Host("hp7475a")
    host.ask(text, 30.0)
    source, made = tmp_path / "a.hpgl", tmp_path / "a.gp"
    source.write_text(text)
    subprocess.run([program, "-q", "-m", "gpt", "-t", "-f", str(made), str(source)], check=True, timeout=60)
    found: list[list[list[float]]] = []
    for before, row in pairwise(made.read_text().splitlines()):
        if before == "#PU":
            found.append([])
        if before in ("#PU", "#PD"):
            found[-1].append([float(value) for value in row.split()])
    lines = [np.array(line) * UNIT / 0.025 for line in found]  # hp2xx takes the nominal unit, and the corner for zero
    corner = np.min(np.concatenate(host.device.drawn.lines), axis=0)
    assert distance(lines, [line - corner for line in host.device.drawn.lines]) < 0.1


@settings(max_examples=40)
@given(st.binary(max_size=200))
def test_no_bytes_break_it(data: bytes) -> None:
    host = Host("hp7475a")
    host.ask(data, 5.0)
    host.device.restart(host.port.now())
    host.hear(4.0)
    assert host.ask(";OI;", 1.0).endswith("7475A\r")
    assert load_profile("hp7475a").name
