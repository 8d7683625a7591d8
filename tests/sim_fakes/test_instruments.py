"""The serial instruments without their ports: what they say when, and their faults."""

import math
import re
import struct

import numpy as np
import pytest

from softarm.fakes.devices import DeviceSurroundings, build_instrument, catalogue
from softarm.fakes.faults import FaultBoard
from softarm.fakes.plant.state import Cord, PlantInputs
from softarm.fakes.scenario import check_scenario
from softarm.fakes.still import StillArm


def make(kind, **keys):
    part = check_scenario({"device": [{"name": "it", "kind": kind, **keys}]}).device[0]
    faults = FaultBoard("it", catalogue(part))
    arm = StillArm()
    return build_instrument(part, DeviceSurroundings(arm, 1), faults), arm


def pull(arm, newtons):
    """Stretch a cord until it pulls so much."""
    stretch = newtons / arm.effects["cord_stiffness"]
    cord = Cord("tip", (0.0, 0.0, -0.5), 0.21 - stretch)
    arm.advance(arm.state.time + 1e-3, PlantInputs(np.zeros(6), cord))
    return arm.state


def say(instrument, arm, count=1, start=0.0):
    """Let it speak ``count`` times from power-on."""
    instrument.power_on(start)
    return [instrument.update(instrument.next_time(), arm.state) for _ in range(count)]


def test_the_cord_pulls_only_when_taut():
    arm = StillArm()
    arm.advance(0.01, PlantInputs(np.zeros(6), Cord("tip", (0.0, 0.0, -0.5), 0.22)))
    assert arm.state.cord_force == 0.0
    state = pull(arm, 5.0)
    assert state.cord_force == pytest.approx(5.0)
    assert state.external_forces[2] == pytest.approx([0.0, 0.0, -5.0])


class TestLutron:
    @pytest.mark.parametrize(
        ("unit", "frame"),
        [
            ("g", rb"\x024157000000(10\d\d)\r"),
            ("kg", rb"\x024155030000(10\d\d)\r"),
            ("N", rb"\x024159020000(10\d\d)\r"),
        ],
    )
    def test_ten_newtons(self, unit, frame):
        gauge, arm = make("lutron", unit=unit)
        pull(arm, 10.05)
        (said,) = say(gauge, arm)
        assert re.fullmatch(frame, said)

    def test_push_is_negative_and_over_range_is_all_nines(self):
        gauge, arm = make("lutron")
        gauge.faults.set("offset", {"newtons": -5.0})
        assert say(gauge, arm)[0][5:6] == b"1"
        gauge.faults.set("over_range")
        assert say(gauge, arm)[0] == b"\x0241570099999999\r"
        gauge.faults.clear()
        pull(arm, 60.0)
        assert say(gauge, arm)[0][7:15] == b"99999999"

    def test_operator_and_power(self):
        gauge, arm = make("lutron", noise_n=0.0)
        pull(arm, 10.0)
        gauge.faults.set("operator_zero")
        gauge.faults.set("unit", {"unit": "oz"})
        assert say(gauge, arm)[0] == b"\x0241580200000000\r"
        gauge.faults.set("power_off")
        assert say(gauge, arm, 3) == [b""] * 3
        assert gauge.faults.counts == {
            **dict.fromkeys(gauge.faults.counts, 0),
            "operator_zero": 1,
            "unit": 1,
            "power_off": 3,
        }

    def test_damaged_frames(self):
        gauge, arm = make("lutron")
        gauge.faults.set("parity")
        assert max(say(gauge, arm)[0]) >= 0x80
        gauge.faults.set("stale_frame")
        assert len(say(gauge, arm)[0]) == 14
        gauge.faults.set("lower_display")
        assert [frame[2:3] for frame in say(gauge, arm, 2)] == [b"2", b"1"]


class TestMark10:
    def ask(self, gauge, arm, command):
        return gauge.receive(0.0, command, arm.state)

    def test_tension_is_negative_in_the_unit_that_is_set(self):
        gauge, arm = make("mark10", noise_n=0.0)
        pull(arm, 10.0)
        assert self.ask(gauge, arm, b"?\r\n") == b"-10.000 N\r\n"
        assert self.ask(gauge, arm, b"LB\r?\r") == b"-2.2481 lbF\r\n"
        assert self.ask(gauge, arm, b"?PT\r") == b"-2.2481 lbF\r\n"
        assert self.ask(gauge, arm, b"CLR\r?PT\r") == b"0.0000 lbF\r\n"
        assert self.ask(gauge, arm, b"Z\r?C\r") == b"0.0000 lbF\r\n"

    def test_list_is_documented_order(self):
        gauge, arm = make("mark10")
        assert self.ask(gauge, arm, b"LIST\r") == b"V1.00;N;CUR;FLTC8;FLTP2;AOUT00;AOFF5;FULL;MIT;POL;B0\r\n"
        gauge.faults.set("no_unit")
        gauge.faults.set("inverted")
        self.ask(gauge, arm, b"FLTC3\rAOFF0\rKG\r")
        listed = self.ask(gauge, arm, b"LIST\r")
        assert listed == b"V1.00;KGF;CUR;FLTC8;FLTP2;AOUT00;AOFF0;NUM;MIT;INV;B0\r\n"
        assert re.fullmatch(rb"-?0\.0\d{3}\r\n", self.ask(gauge, arm, b"?\r"))

    @pytest.mark.parametrize(
        ("command", "error"),
        [
            (b"BOO\r", b"*10"),
            (b"?X\r", b"*12"),
            (b"FLTC11\r", b"*22"),
            (b"AOUT3\r", b"*12"),
            (b"AOUT\r", b"*12"),
        ],
    )
    def test_errors(self, command, error):
        gauge, arm = make("mark10")
        assert self.ask(gauge, arm, command) == error + b"\r\n"

    def test_continuous_output(self):
        gauge, arm = make("mark10")
        gauge.power_on(0.0)
        assert gauge.next_time() is None
        gauge.receive(2.0, b"AOUT10\r", arm.state)
        times = []
        for _ in range(3):
            times.append(gauge.next_time())
            assert gauge.update(times[-1], arm.state).endswith(b" N\r\n")
        assert times == pytest.approx([2.0, 2.1, 2.2])
        gauge.receive(3.0, b"AOUT0\r", arm.state)
        assert gauge.next_time() is None

    def test_split_commands_and_endless_noise(self):
        gauge, arm = make("mark10")
        assert gauge.receive(0.0, b"LI", arm.state) == b""
        assert gauge.receive(0.0, b"ST\r", arm.state).startswith(b"V1.00")
        gauge.receive(0.0, b"x" * 100_000, arm.state)
        assert gauge.receive(0.0, b"\r?\r", arm.state).startswith(b"*10\r\n")


class TestSauter:
    def test_requests_among_other_bytes(self):
        gauge, arm = make("sauter", noise_n=0.0)
        pull(arm, 21.15)
        assert gauge.receive(0.0, b"x9q9", arm.state) == b"1021.15" * 2
        gauge.receive(0.0, b"2", arm.state)
        assert gauge.receive(0.0, b"9", arm.state) == b"1000.00"
        gauge.faults.set("deaf")
        assert gauge.receive(0.0, b"9", arm.state) == b""
        gauge.faults.set("over_range")
        assert gauge.receive(0.0, b"9", arm.state) == b"1999.99"


class TestBend:
    def bent(self, instrument, arm, count):
        return [line.decode() for line in say(instrument, arm, count) if b"," in line]

    def test_distal_sensor_first_in_degrees(self):
        board, arm = make("bendlabs", noise_rad=0.0, boot_s=0.0)
        arm.effects["lag"] = 0.0
        arm.advance(1.0, PlantInputs(np.array([20e3, 0, 0, 0, 10e3, 0.0])))
        last = [float(field) for field in self.bent(board, arm, 60)[-1].split(",")]
        lower, upper = np.degrees(arm.state.bends[1]), np.degrees(arm.state.bends[0])
        assert last[:2] == pytest.approx(lower, abs=0.51)
        assert last[2:4] == pytest.approx(upper, abs=0.51)
        assert last[4:] == [0.0, 0.0]

    def test_the_dead_zone_repeats_and_then_jumps(self):
        board, arm = make("bendlabs", noise_rad=0.0, boot_s=0.0)
        board.power_on(0.0)
        arm.effects["lag"] = 0.0
        shown = []
        for k in range(400):
            arm.advance(0.011 * (k + 1), PlantInputs(np.array([25.0 * k, 0, 0, 0, 0, 0.0])))
            line = board.update(board.next_time(), arm.state).decode().splitlines()[-1]
            shown.append(float(line.split(",")[2]))
        steps = np.abs(np.diff(shown))
        assert np.count_nonzero(steps == 0.0) > 300
        assert steps[steps > 0].min() >= 0.49
        assert shown[-1] < -4.5

    def test_boot_text_then_lines(self):
        board, arm = make("bendlabs", boot_s=1.5)
        board.power_on(10.0)
        assert board.next_time() == 11.5
        assert say(board, arm)[0].startswith(b"BendLabs two-axis sensors\r\n0.00,")
        board.faults.set("cannot_connect", {"sensor": 2})
        restarted, line = (board.update(board.next_time(), arm.state) for _ in range(2))
        assert restarted == b""
        assert b"cannot connect to sensor 2\r\n" in line

    def test_a_dropout_freezes_one_pair(self):
        board, arm = make("bendlabs", noise_rad=0.0, boot_s=0.0)
        board.faults.set("dropout", {"sensor": 1})
        arm.effects["lag"] = 0.0
        arm.advance(1.0, PlantInputs(np.array([20e3, 0, 0, 20e3, 0, 0.0])))
        last = self.bent(board, arm, 60)[-1].split(",")
        assert last[:2] == ["0.00", "0.00"]
        assert abs(float(last[2])) > 5.0

    @pytest.mark.parametrize("kind", ["nan", "inf", "seven", "overflow", "huge", "long", "empty"])
    def test_malformed_lines_strike_once(self, kind):
        board, arm = make("bendlabs", boot_s=0.0)
        say(board, arm)
        board.faults.set("malformed", {"kind": kind})
        odd, even = (board.update(board.next_time(), arm.state) for _ in range(2))
        assert not re.fullmatch(rb"(-?\d+\.\d\d,){5}-?\d+\.\d\d\r\n", odd)
        assert re.fullmatch(rb"(-?\d+\.\d\d,){5}-?\d+\.\d\d\r\n", even)


class TestBno:
    def test_frames_count_up_and_add_up(self):
        imu, arm = make("bno08x_rvc")
        for index, frame in enumerate(say(imu, arm, 300)):
            assert frame[:3] == bytes([0xAA, 0xAA, index & 0xFF])
            assert sum(frame[2:18]) & 0xFF == frame[18]

    def test_it_hangs_upside_down_with_heading_zero_at_reset(self):
        imu, arm = make("bno08x_rvc", noise_rad=0.0)
        frame = say(imu, arm)[0]
        yaw, pitch, roll, _, _, up = struct.unpack("<6h", frame[3:15])
        assert (yaw, pitch, abs(roll)) == (0, 0, 18000)
        assert up == pytest.approx(-1000, abs=10)

    def test_faults_of_one_frame(self):
        imu, arm = make("bno08x_rvc")
        imu.faults.set("bad_checksum")
        frame = say(imu, arm)[0]
        assert sum(frame[2:18]) & 0xFF != frame[18]
        imu.faults.set("byte_slip")
        assert len(say(imu, arm)[0]) == 18
        imu.faults.set("index_gap", {"frames": 5})
        assert [frame[2] for frame in say(imu, arm, 2)] == [5, 6]

    def test_a_false_header_is_a_sound_frame(self):
        imu, arm = make("bno08x_rvc")
        imu.faults.set("false_header")
        frame = say(imu, arm, 171)[170]
        assert frame[:4] == b"\xaa\xaa\xaa\xaa"
        assert sum(frame[2:18]) & 0xFF == frame[18]
        assert imu.faults.counts["false_header"] == 1

    def test_reset_is_silent_and_begins_at_zero(self):
        imu, arm = make("bno08x_rvc")
        say(imu, arm, 10)
        imu.faults.set("reset", {"silent_s": 0.3})
        before = imu.next_time()
        assert imu.update(before, arm.state) == b""
        assert imu.next_time() == pytest.approx(before + 0.3)
        assert imu.update(imu.next_time(), arm.state)[2] == 0


class TestWitMotion:
    def test_configuration_needs_the_unlock_and_locks_again(self):
        imu, arm = make("witmotion")
        assert [frame[1] for frame in (say(imu, arm)[0][k : k + 11] for k in range(0, 44, 11))] == [
            0x51,
            0x52,
            0x53,
            0x54,
        ]
        imu.receive(0.0, bytes.fromhex("ff aa 02 00 02"), arm.state)
        assert len(imu.update(imu.next_time(), arm.state)) == 44
        imu.receive(0.0, bytes.fromhex("ff aa 69 88 b5 ff aa 02 00 02 ff aa 03 09 00"), arm.state)
        frame = imu.update(imu.next_time(), arm.state)
        assert (len(frame), frame[1]) == (11, 0x59)
        imu.receive(10.1, bytes.fromhex("ff aa 02 1e 00"), arm.state)
        assert imu.update(imu.next_time(), arm.state)[1] == 0x59

    def test_what_is_not_saved_is_lost_with_the_power(self):
        imu, arm = make("witmotion", needs_unlock=False)
        imu.receive(0.0, bytes.fromhex("ff aa 02 00 02"), arm.state)
        assert len(say(imu, arm)[0]) == 44
        imu.receive(0.0, bytes.fromhex("ff aa 02 00 02 ff aa 00 00 00"), arm.state)
        assert len(say(imu, arm)[0]) == 11
        imu.faults.set("forgets")
        assert len(say(imu, arm)[0]) == 44

    def test_rate_and_baud_registers(self):
        imu, arm = make("witmotion", needs_unlock=False)
        imu.receive(5.0, bytes.fromhex("ff aa 03 0b 00 ff aa 04 06 00"), arm.state)
        assert imu.baud == 115200
        first = imu.next_time()
        imu.update(first, arm.state)
        assert imu.next_time() - first == pytest.approx(1 / 200)
        imu.receive(5.0, bytes.fromhex("ff aa 03 0d 00"), arm.state)
        assert imu.next_time() is None

    def test_quaternion_of_the_hanging_tip(self):
        imu, arm = make("witmotion", needs_unlock=False, noise_rad=0.0)
        imu.receive(0.0, bytes.fromhex("ff aa 02 00 02"), arm.state)
        frame = imu.update(imu.next_time(), arm.state)
        assert struct.unpack("<4h", frame[2:10]) == pytest.approx((0, 32767, 0, 0), abs=20)


class TestXbus:
    def ask(self, imu, arm, text, time=0.0):
        return imu.receive(time, bytes.fromhex(text), arm.state).hex(" ")

    def test_it_wakes_up_and_measures_unless_answered(self):
        imu, arm = make("xbus")
        assert imu.power_on(0.0).hex(" ") == "fa ff 3e 00 c3"
        assert imu.next_time() == 0.5
        self.ask(imu, arm, "fa ff 3f 00 c2")
        assert imu.next_time() is None

    def test_states_and_acknowledgements(self):
        imu, arm = make("xbus")
        imu.power_on(0.0)
        assert self.ask(imu, arm, "fa ff 10 00 f1") == ""
        assert self.ask(imu, arm, "fa ff 30 00 d1") == "fa ff 31 00 d0"
        assert self.ask(imu, arm, "fa ff c0 00 41") == "fa ff c1 00 40"
        assert self.ask(imu, arm, "fa ff 77 00 8a") == "fa ff 42 01 04 ba"
        assert self.ask(imu, arm, "00 fa ff fa ff 10 00 f1") == "fa ff 11 00 f0"
        assert imu.next_time() == 0.0

    def test_data_counts_and_keeps_its_own_time(self):
        imu, arm = make("xbus", clock_ppm=1000.0)
        imu.power_on(0.0)
        messages = [imu.update(imu.next_time(), arm.state) for _ in range(101)]
        for message in messages:
            assert sum(message[1:]) & 0xFF == 0
        assert struct.unpack(">H", messages[7][7:9]) == (7,)
        (first,), (last,) = (struct.unpack(">I", message[12:16]) for message in (messages[0], messages[-1]))
        assert last - first == pytest.approx(10010, abs=1)
        quaternion = struct.unpack(">4f", messages[0][19:35])
        assert math.hypot(*quaternion) == pytest.approx(1.0, abs=1e-6)

    def test_it_falls_into_configuration(self):
        imu, arm = make("xbus")
        imu.power_on(0.0)
        imu.faults.set("config_mode")
        assert imu.update(imu.next_time(), arm.state) == b""
        assert imu.next_time() is None


def test_the_lab_s_quaternion_line():
    imu, arm = make("quaternion_line", noise_rad=0.0)
    lines = say(imu, arm)[0].decode().splitlines()
    assert [line[:20] for line in lines] == ["Quaternion of IMU 1:", "Quaternion of IMU 2:"]
    assert [abs(float(number)) for number in lines[0][20:].split(",")] == [0.0, 1.0, 0.0, 0.0]


def test_a_beat_that_is_long_past_is_left_out():
    imu, arm = make("bno08x_rvc")
    imu.power_on(0.0)
    imu.update(50.0, arm.state)
    assert imu.next_time() == pytest.approx(50.0)
