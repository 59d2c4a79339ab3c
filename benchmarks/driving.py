"""How well a machine is kept busy: share of the wire, CPU, memory. Simulated machines: python benchmarks/driving.py

wire     a GRBL whose drawing is made of short segments, so that the wire is what limits it: bytes that went over it
         against what 115,200 baud carry; in simulated time.
CPU      the same job over a pseudo-terminal in real time, the machine in another process: process time by wall time.
memory   a job of 100,000 lines to a machine that answers at once: resident memory before and after.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from strokeplan.plotter.cutting import straight
from strokeplan.plotter.driving.codecs import codec_for
from strokeplan.plotter.driving.journal import Journal
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.streamer import Ending, Streamer
from strokeplan.plotter.driving.transport import Transport, open_port
from strokeplan.plotter.driving.units import script
from strokeplan.plotter.profile import Profile, load_profile
from strokeplan.plotter.program import PlotOptions, Program, program
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort
from strokeplan.strokes import Layer, StrokePlan

BAUD = 115200
PIECE_S = 0.25


class Nobody:
    """A control without a person."""

    def wish(self) -> None:
        return None

    def ask(self, text: str) -> bool:
        return True

    def note(self, text: str) -> None:
        print("note:", text)

    def progress(self, done: int, paused: bool) -> None:
        pass


class Counted:
    """A transport that notes when the first and the last byte of drawing went over it."""

    def __init__(self, port: Transport) -> None:
        self.port = port
        self.marks: list[tuple[float, int]] = []

    def write(self, data: bytes) -> int:
        taken = self.port.write(data)
        if taken:
            self.marks.append((self.port.now(), taken))
        return taken

    def read(self, timeout_s: float) -> bytes:
        return self.port.read(timeout_s)

    def now(self) -> float:
        return self.port.now()

    def close(self) -> None:
        self.port.close()

    def share(self) -> float:
        """Of what the wire carries: the median over pieces of a quarter of a second, in which pens may move, too."""
        times = np.array([at for at, _ in self.marks])
        sizes = np.array([size for _, size in self.marks])
        sums = np.bincount(((times - times[0]) / PIECE_S).astype(np.int64), sizes)
        return float(np.median(sums)) / PIECE_S / (BAUD / 10)


class Prompt:
    """A GRBL that carries out everything at once."""

    def __init__(self) -> None:
        self.time, self.out, self.line, self.tool, self.feed = 0.0, b"", b"", "0", "0"
        self.out = b"Grbl 1.1h ['$' for help]\r\n"

    def write(self, data: bytes) -> int:
        for part in data.replace(b"?", b"").split(b"\n")[:-1]:
            words = (self.line + part).decode().split()
            self.line = b""
            for word in words:
                if word[0] == "T":
                    self.tool = word[1:]
                elif word[0] == "F":
                    self.feed = word[1:]
            if words == ["$G"]:
                self.out += f"[GC:G1 G54 G17 G21 G90 G94 M5 M9 T{self.tool} F{self.feed} S0]\r\n".encode()
            self.out += b"ok\r\n"
        if b"?" in data:
            self.out += b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
        self.line += data.replace(b"?", b"").rpartition(b"\n")[2]
        return len(data)

    def read(self, timeout_s: float) -> bytes:
        self.time += 0.0002 if self.out else timeout_s
        data, self.out = self.out, b""
        return data

    def now(self) -> float:
        return self.time

    def close(self) -> None:
        pass


def job_of(chains: list[np.ndarray], profile: Profile) -> Program:
    """A program of chains on 280 × 200 mm."""
    n = len(chains)
    plan = StrokePlan(
        width=280.0,
        height=200.0,
        points=np.concatenate(chains),
        starts=np.cumsum([0, *map(len, chains)]),
        widths=np.full(n, 0.5),
        colors=np.zeros((n, 3), np.uint8),
        layers=(Layer("1", 0, n, "ink"),),
        settings={"page_mm": [280.0, 200.0]},
    )
    return program(plan, profile, PlotOptions(keep_order=True))


def short_segments(lines: int, points: int) -> Program:
    """Waves in pieces of 0.1 mm: 1,000 commands a second at their feed, more than the wire carries."""
    chains = []
    for k in range(lines):
        x = 5 + 0.08 * np.arange(points)
        y = 8 + 180 * (k + 0.5) / lines + 0.9 * np.sin(x)
        chains.append(straight(np.column_stack([x, y]), np.array([len(x)])))
    profile = load_profile("grbl_servo")
    import msgspec

    speeds = msgspec.structs.replace(
        profile.speeds, draw_mm_min=6000.0, acceleration_mm_s2=(20000.0, 20000.0), junction_deviation_mm=1.0
    )
    dialect = msgspec.structs.replace(profile.dialect, curves="lines")
    profile = msgspec.structs.replace(profile, speeds=speeds, dialect=dialect, tolerance_mm=0.0004)
    return job_of(chains, profile)


def drive(job: Program, port: Transport, folder: Path) -> Ending:
    """Draw a job once, with a journal on the disk."""
    work = script(job)
    codec = codec_for(job.profile, work.phrases(0))
    link = Link(port)
    print("  ", codec.greet(link), end="; ")
    log = Journal(folder / "progress.log", work.describe)
    ending = Streamer(link, codec, work, Nobody(), log).run()
    log.close()
    print(f"{ending.done:,} of {len(work):,} lines")
    return ending


def resident_mb() -> float:
    """Memory that the process has now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def wire(folder: Path) -> None:
    for lines, points in ((2, 3000), (6, 1000)):
        job = short_segments(lines, points)
        port = Counted(SimulatedPort(firmware(job.profile), BAUD))
        drive(job, port, folder)
        (folder / "progress.log").unlink()
        print(f"wire: {lines} lines of {points} points: {100 * port.share():.1f} % of 115,200 baud")


def cpu(folder: Path) -> None:
    job = short_segments(40, 400)
    simulate = [sys.executable, "-m", "strokeplan", "simulate", "grbl_servo", "--port", "pty"]
    with subprocess.Popen(simulate, stdout=subprocess.PIPE, text=True) as machine:
        assert machine.stdout is not None  # noqa: S101
        url = machine.stdout.readline().split()[-1]
        port = Counted(open_port(url, BAUD))
        wall, used = time.monotonic(), time.process_time()
        drive(job, port, folder)
        wall, used = time.monotonic() - wall, time.process_time() - used
        port.close()
        machine.terminate()
    print(f"CPU: {100 * used / wall:.1f} % of a core in {wall:.0f} s, at {100 * port.share():.0f} % of the wire")


def memory(folder: Path, lines: int) -> None:
    rng = np.random.default_rng(2)
    begin = rng.uniform(5, 270, (lines, 1)), rng.uniform(5, 190, (lines, 1))
    steps = np.linspace(0, 4, 8)
    chains = [
        straight(np.column_stack([begin[0][k] + steps, begin[1][k] + np.sin(steps)]), np.array([8]))
        for k in range(lines)
    ]
    job = job_of(chains, load_profile("grbl_servo"))
    del chains
    job.polylines  # noqa: B018
    before, peak = resident_mb(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    begin_s = time.process_time()
    drive(job, Prompt(), folder)
    used = time.process_time() - begin_s
    after, now = resident_mb(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(f"memory: {before:.0f} MB before, {after:.0f} MB after {lines:,} lines; peak {peak:.0f} → {now:.0f} MB")
    print(f"        {1e6 * used / lines:.0f} µs of CPU a line (the simulated machine included)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", default=["wire", "cpu", "memory"], choices=["wire", "cpu", "memory"])
    parser.add_argument("--lines", type=int, default=100_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for what in given.what:
            if what == "memory":
                memory(Path(folder), given.lines)
            else:
                {"wire": wire, "cpu": cpu}[what](Path(folder))
            (Path(folder) / "progress.log").unlink(missing_ok=True)


if __name__ == "__main__":
    main()
