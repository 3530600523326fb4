"""The host's end of the serial line, against boards that answer as they should and otherwise."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from fake_board import LIMITS, FakeBoard, silent

from mazeplan.core.errors import RigError
from mazeplan.rigs.link.board import Board, Timeouts
from mazeplan.rigs.link.protocol import Flag, encode

SHORT = Timeouts(answer_s=0.4, listen_s=0.1, again_s=0.05, silence_s=0.15)


def refused(port, limits=LIMITS):
    """One line with which `open` gives up."""
    board = Board(port, limits, SHORT)
    with pytest.raises(RigError) as caught:
        board.open()
    board.close()
    assert str(caught.value).startswith(f"{port}: ")
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def until(true, timeout_s=3.0):
    end = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_it_says_who_is_there_commands_and_levels():
    with FakeBoard() as fake, Board(fake.port, LIMITS, SHORT) as board:
        assert board.identity is not None
        assert (board.identity.version, board.identity.max_us) == ("1.0", 2200.0)
        before = board.latest()
        number = board.command(1510.06, 9999.0)
        report = board.wait_confirmed(number, 1.0)
        assert report is not None
        assert report is not before
        assert report.counts == (512.0, 500.0)
        assert fake.got[-1].fields[1:] == ("15101", "18000")  # the second was clamped here already
        assert Flag.LEVEL not in report.flags
        assert Flag.LEVEL in board.level().flags
        newest = board.latest()
        assert board.wait_newer(newest, 1.0) is not newest
        until(lambda: len(board.recent()) > 5)
        times = [report.time_s for report in board.recent()]
        assert times == sorted(times)
        assert board.recent()[-1].time_s >= report.time_s
    assert fake.got[-1].kind == "Z"  # closing levels


def test_command_numbers_survive_the_wrap_of_the_line():
    with FakeBoard() as fake, Board(fake.port, LIMITS, SHORT) as board:
        fake.accepted = 9  # of somebody who commanded before
        assert board.wait_confirmed(1, 0.1) is None
        board._sent = 65533
        for _ in range(4):
            assert board.wait_confirmed(board.command(1500, 1500), 1.0) is not None
        assert [frame.fields[0] for frame in fake.got if frame.kind == "C"] == ["65534", "65535", "1", "2"]


def test_a_silent_port_and_one_that_speaks_otherwise():
    with FakeBoard(reports=False, I=silent) as fake:
        assert "does not answer" in refused(fake.port)
    with FakeBoard(reports=False, noise=b"\xff\x00 hello\r\n" * 20, I=silent) as fake:
        assert "but no answer; another firmware" in refused(fake.port)


def test_another_firmware_and_another_protocol():
    with FakeBoard(I=lambda board, frame: encode("I", frame.fields[0], "kettle", 1, "0.3")) as fake:
        assert "got protocol 1 of firmware 'kettle' 0.3, expected 1 of 'mazeplan'" in refused(fake.port)
    with FakeBoard(I=lambda board, frame: encode("I", frame.fields[0], "mazeplan", 2, "2.0", 1, 2, 3)) as fake:
        assert "got protocol 2 of firmware 'mazeplan' 2.0, expected 1 of 'mazeplan'" in refused(fake.port)
    with FakeBoard(I=lambda board, frame: encode("I", frame.fields[0], "mazeplan", "?", "2.0")) as fake:
        assert "no answer" in refused(fake.port)


def test_limits_that_the_firmware_does_not_take_as_they_are():
    def narrow(board, frame):
        number, axis, *_, level, slew = frame.fields
        return encode("L", number, axis, 14000, 16000, level, slew)

    with FakeBoard(L=narrow) as fake:
        said = refused(fake.port)
    assert "got limits 1200 to 1800 us, 5000 us/s for beta" in said
    assert "allows 800 to 2200 us" in said
    with FakeBoard(L=silent) as fake:
        assert "no answer" in refused(fake.port)


def test_answers_that_were_lost_are_asked_for_again():
    asked = []

    def third(board, frame):
        asked.append(frame)
        return encode("I", frame.fields[0], "mazeplan", 1, "1.0", 8000, 22000, 20000, 200, 1) if len(asked) > 2 else b""

    with FakeBoard(I=third) as fake, Board(fake.port, LIMITS, SHORT) as board:
        assert board.latest() is not None
    assert len(asked) == 3


def test_a_flood_of_noise_between_frames_is_no_trouble():
    noise = bytes(np.random.default_rng(1).integers(0, 256, 2000).tolist())
    with FakeBoard(noise=noise) as fake, Board(fake.port, LIMITS, Timeouts(silence_s=0.5)) as board:
        for _ in range(5):
            assert board.wait_confirmed(board.command(1500, 1500), 2.0) is not None


def test_a_lost_port_ends_in_an_error_that_names_it():
    with FakeBoard() as fake:
        board = Board(fake.port, LIMITS, SHORT)
        board.open()
        waiting = []

        def wait():
            with pytest.raises(RigError) as caught:
                board.wait_confirmed(99, 5.0)
            waiting.append(caught.value)

        thread = threading.Thread(target=wait)
        thread.start()
        fake.unplug()
        thread.join()
    assert waiting
    for call in (board.latest, board.level, lambda: board.command(1500, 1500), lambda: board.wait_newer(None, 1.0)):
        with pytest.raises(RigError, match="was lost") as caught:
            call()
        assert str(caught.value).startswith(fake.port)
    began = time.monotonic()
    board.close()
    board.close()
    assert time.monotonic() - began < 1.0


def test_a_silent_board_is_lost():
    with FakeBoard() as fake, Board(fake.port, LIMITS, SHORT) as board:
        fake.reports = False
        time.sleep(0.5)
        with pytest.raises(RigError, match=fake.port):
            board.command(1500, 1500)


def test_a_board_that_began_anew_gets_its_limits_again():
    with FakeBoard() as fake, Board(fake.port, LIMITS, SHORT) as board:
        before = board.latest()
        fake.got.clear()
        fake.flags, fake._began = 2 | 4, time.monotonic()
        until(lambda: sum(frame.kind == "L" for frame in fake.got) >= 2)
        fake.flags = 4
        assert board.wait_newer(before, 1.0) is not None
