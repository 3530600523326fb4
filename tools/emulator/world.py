"""The world of the emulated rig: machine, board and camera in real time, in a separate process.

    pulses at the pins --Servos--> machine --Diode--> volts at the inputs     the board runs the firmware, in simavr
    machine --Overhead, delay_ms later--> pictures

    python -m emulator.world FD     writes pictures into the file FD, in SLOTS places in turn

Orders come on stdin, one JSON document a line. The first has map and settings. The others are:

    {"place": [ring, theta, seed]}   place the ball
    {"remove": true}                 remove the ball
    {"tilt": true}                   ask for the true tilt
    {"end": true}                    end

The world also ends `linger_s` after the end of stdin. So its trace still shows the plate after the program has died.
Answers go to stdout:

    {"ready": port}
    {"frame": slot, "lost": pictures lost so far on a slow machine, ...}
    {"tilt": [beta, gamma]}
    {"problem": text}
"""

from __future__ import annotations

import json
import mmap
import os
import queue
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any, TextIO

import numpy as np

from emulator.chip import EmulatedChip, built
from emulator.look import Look
from emulator.render import Overhead, over
from emulator.settings import WorldSettings
from emulator.truth import Truth
from mazeplan.core.errors import MazeplanError, SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text
from mazeplan.rigs.files import validated
from mazeplan.rigs.sim.machine import CHUNKS, Machine
from mazeplan.rigs.sim.settings import SimulatedSettings

SLOTS = 8  # places for pictures in the shared file
PICTURES_HZ = 30.0
BEHIND = 10  # niceness of the renderer, so that it takes no computing time from program and board
LATE_S = 0.2  # s, largest lag behind the wall clock that the world catches up
Shot = tuple[float, Any, float, float]  # exposure (host's clock), ball (3,) or None, beta, gamma


class EmulatedCamera(threading.Thread):
    """Renders each shot, and delivers the picture after the delay."""

    def __init__(self, overhead: Overhead, memory: mmap.mmap, delay_s: float, say: Callable[[dict], None]) -> None:
        super().__init__(name="camera", daemon=True)
        self.shots: queue.Queue[Shot | None] = queue.Queue(maxsize=3)  # None: the end
        self.rng = np.random.default_rng(0)
        self.lost = 0
        self._overhead, self._memory, self._delay, self._say = overhead, memory, delay_s, say

    def run(self) -> None:
        """Render until the end."""
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), BEHIND)
        number = 0
        while (shot := self.shots.get()) is not None:
            exposed, ball, beta, gamma = shot
            if monotonic() > exposed + self._delay and not self.shots.empty():
                self.lost += 1
                continue  # on a slow machine some pictures are lost, so that the others come in time
            image = self._overhead.render(ball, beta, gamma, self.rng)
            slot, number = number % SLOTS, number + 1
            size = image.nbytes
            self._memory[slot * size : (slot + 1) * size] = image.tobytes()
            time.sleep(max(0.0, exposed + self._delay - monotonic()))  # the delay of a real camera
            self._say({"frame": slot, "exposed": exposed, "out": monotonic(), "lost": self.lost})

    def end(self) -> None:
        """End the thread and wait for it, because an interpreter that ends during compiled code crashes."""
        self.shots.put(None)
        self.join()


def appearance(given: dict[str, Any]) -> Look:
    """Appearance of the pictures. Raises SettingsError for an unknown key or value."""
    try:
        return Look(**{"sharp": False, **given})
    except (TypeError, ValueError) as problem:
        raise SettingsError(str(problem).removeprefix("Look.__init__() "), key="world.look") from None


class EmulatedWorld:
    """Machine, board and camera of the emulated rig.

    memory: gets the pictures.
    say: sends an answer.
    folder: folder for files of the chip."""

    def __init__(
        self, maze: Maze, settings: WorldSettings, memory: mmap.mmap, say: Callable[[dict], None], folder: Path
    ) -> None:
        self.maze, self.settings, self._say = maze, settings, say
        self.truth = Truth.drawn(settings.seed)
        physics = validated(SimulatedSettings, dict(settings.physics))
        self.machine = Machine(maze, SimulatedSettings(**{**dict(physics), "rate_hz": 2.0 * PICTURES_HZ}))
        self.machine.reset(ring=1, theta=0.0)
        self.here = False  # whether there is a ball
        self.chip = EmulatedChip(*built(), folder, apart=False)
        self.chip.set_volts(*self.truth.diode.volts(0.0, 0.0))
        self.chip.set_noise(1e-3 * settings.diode_noise_mv)
        overhead = Overhead(maze, over(self.truth.camera, maze), appearance(settings.look))
        self.camera = EmulatedCamera(overhead, memory, 1e-3 * settings.camera_delay_ms, say)
        self._orders: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._trace: TextIO | None = None
        if settings.trace is not None:
            self._trace = Path(settings.trace).open("w", buffering=1)  # noqa: SIM115
            self._trace.write("t,pulse_beta_us,pulse_gamma_us,target_beta,target_gamma,beta,gamma,x,y\n")

    def order(self, document: dict[str, Any]) -> None:
        """Queue an order for the next step. Any thread may call."""
        self._orders.put(document)

    def run(self, ended: threading.Event) -> None:
        """Run until `ended` is set, or the board is lost."""
        self.camera.start()
        try:
            self._simulate(ended)
        except MazeplanError as problem:
            self._say({"problem": str(problem)})
        finally:
            self.chip.close()
            self.camera.end()

    def _simulate(self, ended: threading.Event) -> None:
        step, count = self.machine.chunk_s, 0
        zero = monotonic()  # wall time at which the machine's time is 0
        while not ended.is_set():
            now = zero + (count + 1) * step
            ahead = now - monotonic()
            if ahead > 0.0:
                time.sleep(ahead)  # the machine must run in real time, because the board's firmware does
            elif ahead < -LATE_S:
                zero -= ahead
                now -= ahead
            self._step(now)
            count += 1
            if count % (2 * CHUNKS) == 0:
                self._expose(now)

    def _step(self, now: float) -> None:
        machine, chip = self.machine, self.chip
        while not self._orders.empty():
            self._obey(self._orders.get())
        beta_us, gamma_us, _ = chip.pulses()
        if beta_us > 0.0 and gamma_us > 0.0:  # without pulses the servos stay where they are
            machine.aim(*self.truth.servos.tilt(beta_us, gamma_us))
        machine.step()
        chip.set_volts(*self.truth.diode.volts(*machine.gimbal.tilt))
        if self._trace is not None:
            target = self.truth.servos.tilt(beta_us, gamma_us)
            x, y = machine.scenes()[0][:2]
            row = (now, beta_us, gamma_us, *target, *machine.gimbal.tilt, x, y)
            self._trace.write(",".join(f"{value:.6f}" for value in row) + "\n")

    def _expose(self, now: float) -> None:
        ball = self.machine.ball()[0] if self.here else None
        if self.camera.shots.full():
            self.camera.lost += 1
        else:
            self.camera.shots.put((now, ball, *self.machine.gimbal.tilt))

    def _obey(self, order: dict[str, Any]) -> None:
        if "place" in order:
            ring, theta, seed = order["place"]
            r = self.maze.track_radius(int(ring))
            position = np.array([r * np.cos(theta), r * np.sin(theta), self.maze.ball.radius])
            self.machine.set_ball(position, np.zeros(3), np.zeros(3))
            self.camera.rng = np.random.default_rng(int(seed))
            self.here = True
        elif "remove" in order:
            self.here = False
        elif "tilt" in order:
            self._say({"tilt": self.machine.gimbal.tilt})


def main() -> None:
    """Run one world; see the module's docstring."""
    memory = mmap.mmap(int(sys.argv[1]), 0)
    speaking = threading.Lock()

    def say(document: dict[str, Any]) -> None:
        try:
            with speaking:
                sys.stdout.write(json.dumps(document) + "\n")
                sys.stdout.flush()
        except OSError:  # the program has ended, and the world lingers
            pass

    first = json.loads(sys.stdin.readline() or "{}")
    try:
        maze = check_text(first["map"]).maze
        assert maze is not None
        settings = validated(WorldSettings, first["world"])
        world = EmulatedWorld(maze, settings, memory, say, Path(first["folder"]))
    except MazeplanError as problem:
        say({"problem": str(problem)})
        return
    ended = threading.Event()

    def listen() -> None:
        for line in sys.stdin:
            order = json.loads(line)
            if "end" in order:
                break
            world.order(order)
        else:
            time.sleep(settings.linger_s)
        ended.set()

    threading.Thread(target=listen, name="orders", daemon=True).start()
    say({"ready": world.chip.port})
    world.run(ended)


if __name__ == "__main__":
    main()
