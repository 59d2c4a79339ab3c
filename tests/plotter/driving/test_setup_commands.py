"""The commands that set a machine up, against simulated machines."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import heard
from drawings import EYE, SWAN, drawing
from machines import Port
from typer.testing import CliRunner

from strokeplan.cli import app
from strokeplan.errors import StrokeplanError
from strokeplan.formats import save
from strokeplan.plotter.driving.codecs import baud_of
from strokeplan.plotter.driving.ports import IDS
from strokeplan.plotter.driving.ports import Port as Listed
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.serving import PtyServer, serve

Machines = Callable[..., Port]


def run(*words: object) -> str:
    """What a command prints; its error, if it raises one."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path / "config" / "strokeplan" / "profiles"


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machines:
    """A machine that is plugged in: whatever opens a port opens its."""

    def plug(name: str, variant: str | None = None) -> Port:
        profile = load_profile(name)
        ports = [Port(firmware(profile, variant=variant), baud_of(profile))]
        ports[0].close()

        def open_port(url: str, baud: int, **_: object) -> Port:
            assert url == "X"
            assert baud == baud_of(profile)
            ports.append(ports[-1].reopen(1.0))  # type: ignore[arg-type]
            return ports[-1]

        monkeypatch.setattr("strokeplan.plotter.driving.transport.open_port", open_port)
        return ports[0]

    return plug


@pytest.fixture
def no_port(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may open a port."""

    def open_port(*_: object, **__: object) -> None:
        raise AssertionError("a port was opened")

    monkeypatch.setattr("strokeplan.plotter.driving.transport.open_port", open_port)


def at(port: Port) -> tuple[float, float]:
    x, y = port.device.place_mm[:2]
    return round(float(x), 2) + 0.0, round(float(y), 2) + 0.0


def test_jog_moves_from_command_to_command(machine: Machines) -> None:
    port = machine("grbl_servo", "grbl-no-reset")
    said = run("jog", "--profile", "grbl_servo", "--port", "X", 30, 20)
    assert "at X30.00 Y20.00, pen up" in said
    assert "Grbl 1.1h" in said
    assert "at X25.50 Y20.00" in run("jog", "--profile", "grbl_servo", "--port", "X", -4.5, 0)
    assert at(port) == (25.5, 20)
    run("jog", "--profile", "grbl_servo", "--port", "X", "--to", "7,8")
    assert at(port) == (7, 8)
    with pytest.raises(StrokeplanError, match=r"X-3 Y8 is beyond the travel of grbl_servo, X 0..300"):
        run("jog", "--profile", "grbl_servo", "--port", "X", -10, 0)
    assert at(port) == (7, 8)
    assert not port.device.pen_down


def test_a_board_that_starts_anew_can_be_told_where_it_is(machine: Machines) -> None:
    """Opening its port resets it: it takes the place where it stands as its zero."""
    port = machine("grbl_servo")
    said = run("jog", "--profile", "grbl_servo", "--port", "X", 30, 20)
    assert "note: opening the port started the machine anew: X0 Y0 is where it stands now" in said
    with pytest.raises(StrokeplanError, match=r"does not know where it stands; home it first \(--home\)"):
        run("origin", "--save", "--profile", "grbl_servo", "--port", "X")
    assert "at X10.00 Y10.00" in run("jog", "--profile", "grbl_servo", "--port", "X", "--at", "30,20", -20, -10)
    assert at(port) == (10, 10)


@pytest.mark.usefixtures("no_port")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["jog", "--to", "301,0"], "X301 Y0 is beyond the travel of grbl_servo"),
        (["jog", "0", "230"], "Y by 230 mm is more than the travel of grbl_servo, 220 mm"),
        (["jog", "--at", "290,0", "20", "0"], "X310 Y0 is beyond the travel"),
        (["jog", "1", "2", "3"], "X Y '1,2,3' is not two numbers, like 10,-5"),
        (["jog", "1", "x"], "X Y '1,x' is not two numbers"),
        (["jog", "nan", "1"], "X Y 'nan,1' is not two numbers"),
        (["jog", "--to", "5"], "--to '5' is not two numbers"),
        (["jog", "--to", "5,5", "1", "1"], "give X Y, or --to X,Y, not both"),
        (["jog"], "jog without X Y needs a terminal"),
        (["pen", "down", "--height", "1"], "--height is not for grbl_servo, whose pen is set by --pwm"),
        (["pen", "down", "--pwm", "-1"], "--pwm -1: Expected `float` >= 0"),
        (["pen", "up", "--save"], "--save: no height is given"),
        (["pen", "cycle", "--pen", "red"], "says nothing of a pen 'red'; of its own it has none"),
    ],
)
def test_what_cannot_be_is_said_before_a_port_is_opened(words: list[str], said: str) -> None:
    with pytest.raises(StrokeplanError) as error:
        run(*words, "--profile", "grbl_servo", "--port", "X")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.usefixtures("no_port")
def test_files_only_and_unknown_machines() -> None:
    with pytest.raises(StrokeplanError, match="cannot be driven over a port"):
        run("home", "--profile", "linuxcnc", "--port", "auto")
    with pytest.raises(StrokeplanError, match="'none' is unknown"):
        run("home", "--profile", "none")


def test_home(machine: Machines) -> None:
    port = machine("grbl_servo", "grbl-homing")
    with pytest.raises(StrokeplanError, match="locked"):
        run("jog", "--profile", "grbl_servo", "--port", "X", 5, 5)
    assert "home; at X0.00 Y0.00, pen up" in run("home", "--profile", "grbl_servo", "--port", "X")
    assert "at X5.00 Y5.00" in run("jog", "--home", "--profile", "grbl_servo", "--port", "X", 5, 5)
    assert at(port) == (5, 5)


def test_origin_and_its_offset(machine: Machines, own_folder: Path) -> None:
    port = machine("grbl_servo", "grbl-no-reset")
    run("jog", "--profile", "grbl_servo", "--port", "X", 30, 20)
    said = run("origin", "--profile", "grbl_servo", "--port", "X", "--save")
    assert "wrote offset_mm = [30.00, 20.00] to" in said
    assert "a copy that goes before the one that ships" in said
    assert load_profile("grbl_servo").machine.offset_mm == (30, 20)
    (own_folder / "grbl_servo.toml").unlink()
    said = run("origin", "--profile", "grbl_servo", "--port", "X")
    assert "the page's lower left corner is here: at X0.00 Y0.00, pen up; G92, which lasts until" in said
    run("jog", "--profile", "grbl_servo", "--port", "X", "--to", "1,1")
    assert at(port) == (31, 21)
    assert port.device.forbidden == ()


def test_frame_goes_around_as_plot_would_lay_it_out(machine: Machines, tmp_path: Path) -> None:
    save(drawing([SWAN, EYE]), tmp_path / "plan.json")
    port = machine("grbl_servo")
    said = run(
        "frame", tmp_path / "plan.json", "--profile", "grbl_servo", "--port", "X", "--page", "A5", "--margin", 20
    )
    x, y = re.findall(r"([\d.]+)\.\.([\d.]+)", said.partition("drawing")[2])[:2]
    moves = [line for line in port.device.received if line.startswith("G0")]  # type: ignore[attr-defined]
    corners = [f"G0X{float(a):g}Y{float(b):g}" for a, b in [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]]
    assert [re.sub(r"(\.\d\d)\d", r"\1", move) for move in moves[:4]] == corners
    assert at(port) == (0, 0)
    assert not port.device.drawn.lines
    with pytest.raises(StrokeplanError, match="larger than what grbl_servo reaches"):
        run("frame", tmp_path / "plan.json", "--profile", "grbl_servo", "--port", "X", "--page", "A1")


def test_pen_down_comes_up_again_and_is_saved(machine: Machines, own_folder: Path) -> None:
    port = machine("grbl_servo")
    words = ("--profile", "grbl_servo", "--port", "X")
    said = run("pen", "down", *words, "--pwm", 420, "--seconds", 5, "--save")
    assert "the pen is down at 420 (down_pwm), for 5 s" in said
    assert f"wrote down_pwm = 420 to {own_folder / 'grbl_servo.toml'}" in said
    assert not port.device.pen_down
    begins, ends = port.device.drawn.rests[0]
    assert 4.5 < ends - begins < 6
    assert load_profile("grbl_servo").tool.down_pwm == 420  # type: ignore[union-attr]
    assert "M3S420" in port.device.received  # type: ignore[attr-defined]
    assert "stays down" in run("pen", "down", *words, "--stay")
    assert port.device.pen_down
    assert "the pen is up" in run("pen", "up", *words)
    assert not port.device.pen_down


@pytest.mark.parametrize(
    ("name", "option", "value"),
    [("ender3", "--height", -0.2), ("axidraw_v3", "--percent", 25), ("grbl_servo", "--pwm", 350), ("hp7475a", None, 0)],
)
def test_pen_cycle(machine: Machines, name: str, option: str | None, value: float) -> None:
    port = machine(name)
    tried = () if option is None else (option, value)
    said = run("pen", "cycle", "--profile", name, "--port", "X", "--times", 4, *tried)
    assert f"{value:g} (" in said or option is None
    assert len(port.device.drawn.lines) == 4
    assert not port.device.pen_down


def test_auto_takes_the_only_one(machine: Machines, monkeypatch: pytest.MonkeyPatch) -> None:
    port = machine("axidraw_v3")
    there = [Listed("X", "", "04D8:FD92", *IDS[0x04D8, 0xFD92]), Listed("Y", "", "1A86:7523", *IDS[0x1A86, 0x7523])]
    monkeypatch.setattr("strokeplan.plotter.driving.ports.plugged_in", lambda: there)
    said = run("jog", "--profile", "axidraw_v3", 10, 5)
    assert "port        X: EiBotBoard" in said
    assert "taken to stand at X0 Y0" in said
    assert at(port) == (10, 5)
    there.append(Listed("Z", "", "04D8:FD92", *IDS[0x04D8, 0xFD92]))
    with pytest.raises(StrokeplanError, match=r"2 ports may be axidraw_v3 \(EBB\): X \(EiBotBoard\), Z"):
        run("jog", "--profile", "axidraw_v3", 10, 5)
    assert run("ports").splitlines()[1].startswith("Y              1A86:7523 CH340: GRBL or")


def test_plot_finds_its_port_and_says_where_the_machine_is(
    machine: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(drawing([SWAN, EYE]), tmp_path / "plan.json")
    port = machine("grbl_servo", "grbl-no-reset")
    there: list[Listed] = []
    monkeypatch.setattr("strokeplan.plotter.driving.ports.plugged_in", lambda: there)
    words = (tmp_path / "plan.json", "--profile", "grbl_servo", "--port", "auto", "--yes", "--jobs", tmp_path / "jobs")
    with pytest.raises(StrokeplanError, match="no port looks like grbl_servo"):
        run("plot", *words)
    there.append(Listed("X", "", "1A86:7523", *IDS[0x1A86, 0x7523]))
    run("jog", "--profile", "grbl_servo", "--port", "auto", 30, 20)
    said = run("plot", *words)
    assert "the machine says that it is at X30.00 Y20.00: that is believed" in said
    assert "drawn       all 2 strokes" in said
    assert len(port.device.drawn.lines) == 2


def test_a_machine_of_another_kind_is_refused_by_name(machine: Machines) -> None:
    port = machine("ender3")
    with pytest.raises(StrokeplanError, match="answers as Marlin, and the profile speaks GRBL"):
        run("jog", "--profile", "grbl_servo", "--port", "X", 10, 5)
    assert at(port) == (0, 0)


class Terminal:
    """A command at a pseudo-terminal, and the machine behind another one, in real time."""

    def __init__(self, name: str, *words: str) -> None:
        self.device = firmware(load_profile(name))
        self.server = PtyServer()
        self.thread = threading.Thread(target=self._serve, args=(baud_of(load_profile(name)),), daemon=True)
        self.thread.start()
        self.keys, inner = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "strokeplan", *words, "--profile", name, "--port", self.server.url],
            stdin=inner, stdout=inner, stderr=inner, start_new_session=True,
            preexec_fn=lambda: _control(inner),
        )  # fmt: skip
        os.close(inner)
        self.said = ""

    def _serve(self, baud: int) -> None:
        try:
            serve(self.device, self.server, baud, told=self._told)
        except KeyboardInterrupt:
            self.server.close()

    def _told(self, what: str) -> None:
        if what == "closed":
            raise KeyboardInterrupt

    def until(self, pattern: str) -> None:
        """Read until it is said."""
        while not re.search(pattern, self.said):
            said = heard(self.keys)
            assert said, f"{pattern!r} was not said: {self.said}"
            self.said += said.decode()

    def type(self, text: str) -> None:
        self.said = ""
        os.write(self.keys, text.encode())

    def end(self) -> int:
        """Its exit code."""
        while said := heard(self.keys):
            self.said += said.decode()
        self.thread.join(20)
        os.close(self.keys)
        return self.process.wait(20)


def _control(terminal: int) -> None:
    """Make a terminal that of the process, so that Ctrl-C reaches it."""
    import fcntl
    import termios

    fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)


def test_at_a_terminal() -> None:
    """Arrow keys move, Ctrl-C with the pen down raises it; over a real pseudo-terminal, in real time."""
    pytest.importorskip("serial")
    jog = Terminal("grbl_servo", "jog")
    jog.until("step 1 mm")
    jog.type("\x1b[C\x1b[C5\x1b[A")
    jog.until(r"at X2.00 Y10.00, pen up; step 10 mm")
    jog.type("\x1b[D")
    jog.until(r"note: X-8 Y10 is beyond the travel")
    jog.type("d")
    jog.until("pen down")
    jog.type("\x03")
    assert jog.end() == 1
    assert "error: stopped; the pen is up" in jog.said
    assert at(jog) == (2, 10)  # type: ignore[arg-type]
    assert not jog.device.pen_down
