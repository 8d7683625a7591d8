"""Scenarios, faults, control requests, concealed effects, the world and its clock."""

import asyncio
import json
import socket
import time
from pathlib import Path

import numpy as np
import pytest

from acceptance.warp import WarpLoop
from softarm.estimator.errors import InputError
from softarm.fakes.control import ControlPort, serve
from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.plant.state import Cord, Hand
from softarm.fakes.rig import running
from softarm.fakes.rotation import columns, from_rotation_vector, multiply
from softarm.fakes.scenario import check_scenario, read_scenario
from softarm.fakes.still import StillArm
from softarm.fakes.world import FakeArmWorld

SCENARIOS = Path(__file__).parents[2] / "sim_fakes" / "softarm" / "fakes" / "scenarios"
TABLE = {
    "plant": {"kind": "still"},
    "device": [
        {"name": "valves", "kind": "festo_mpa"},
        {"name": "qtm", "kind": "qualisys"},
        {"name": "gauge", "kind": "lutron"},
    ],
}


EXACT = {"angle_noise_rad": 0.0}


def warp(main):
    with asyncio.Runner(loop_factory=lambda: WarpLoop(50.0)) as runner:
        return runner.run(main())


class TestScenario:
    def test_the_shipped_ones_are_sound(self):
        names = [path.stem for path in sorted(SCENARIOS.glob("*.toml")) if read_scenario(path).device]
        assert {"bad_day", "bench"} <= set(names)

    @pytest.mark.parametrize(
        ("change", "told"),
        [
            ({"sead": 3}, "sead: unknown key, did you mean 'seed'"),
            ({"step_s": 0.0}, "step_s: input should be greater than 0"),
            ({"plant": {"kind": "mujoco"}}, "plant.kind: input should be 'arm' or 'still'"),
            ({"device": []}, "device: tuple should have at least 1"),
            (
                {"device": [{"name": "a", "kind": "lutron", "bauds": 1}]},
                "device.0.bauds: unknown key, did you mean 'baud'",
            ),
            ({"device": [{"name": "a", "kind": "lutran"}]}, "device.0: input tag 'lutran'"),
            ({"device": [{"name": "A b", "kind": "lutron"}]}, "device.0.name"),
            ({"device": 2 * [{"name": "a", "kind": "lutron"}]}, "two devices are named 'a'"),
            (
                {"device": [{"name": "a", "kind": "festo_mpa"}, {"name": "b", "kind": "festo_vtem"}]},
                "two valve terminals",
            ),
            (
                {"device": [{"name": "a", "kind": "festo_mpa", "valve_map": [1, 1, 2, 3, 4, 5]}]},
                "names a valve twice",
            ),
            (
                {"fault": [{"at_s": 1.0, "device": "nobody", "fault": "x"}]},
                "fault.0.device: no device 'nobody'",
            ),
            ({"fault": [{"at_s": -1.0, "device": "qtm", "fault": "x"}]}, "fault.0.at_s"),
        ],
    )
    def test_mistakes_are_named(self, change, told):
        with pytest.raises(InputError) as caught:
            check_scenario({**TABLE, **change}, "bench.toml")
        assert told in str(caught.value)
        assert str(caught.value).startswith("bench.toml: ")

    def test_all_mistakes_come_at_once(self):
        with pytest.raises(InputError) as caught:
            check_scenario({"sead": 1, "device": [{"name": "a", "kind": "lutron", "rate_hz": 61}]})
        assert "sead" in str(caught.value)
        assert "rate_hz" in str(caught.value)

    def test_files_that_cannot_be_read(self, tmp_path):
        with pytest.raises(InputError, match="cannot be read"):
            read_scenario(tmp_path / "none.toml")
        broken = tmp_path / "broken.toml"
        broken.write_text("name = ")
        with pytest.raises(InputError, match="is not TOML"):
            read_scenario(broken)

    def test_a_variant_is_the_arm_that_recordings_of_its_seed_are_of(self):
        pytest.importorskip("mujoco")
        from softarm.fakes.plant.variants import variant

        table = {"plant": {"variant": 2}, "device": [{"name": "qtm", "kind": "qualisys"} | EXACT]}

        async def main():
            async with running(check_scenario(table)) as rig:
                return rig.plant.parameters, rig.qtm_servers["qtm"], rig.state

        parameters, server, state = warp(main)
        drawn = variant(2)
        assert parameters == drawn.arm
        seen = server.measurement._pose(server.measurement.bodies[2], state)
        wanted = columns(
            multiply(
                tuple(state.quaternions[2]), from_rotation_vector(tuple(drawn.instruments.alignments[2]))
            )
        )
        np.testing.assert_allclose(seen.rotation, wanted, atol=1e-9)

    @pytest.mark.parametrize(
        ("change", "told"),
        [
            (
                {"device": [{"name": "v", "kind": "festo_mpa", "valve_map": [0, 1]}]},
                "2 entries, the arm has 6",
            ),
            ({"device": [{"name": "b", "kind": "bendlabs", "sensors": ["middle"]}]}, "no 'middle'"),
            ({"device": [{"name": "i", "kind": "xbus", "section": "tips"}]}, "did you mean 'tip'"),
            (
                {"device": [{"name": "q", "kind": "qualisys", "bodies": [{"name": "0", "section": "x"}]}]},
                "no 'x'",
            ),
            ({"cord": {"section": "nose", "hook_m": [0, 0, 0], "length_m": 1}}, "no section 'nose'"),
            ({"fault": [{"at_s": 1, "device": "qtm", "fault": "bodylost"}]}, "did you mean 'body_lost'"),
            ({"plant": {"kind": "still", "variant": 1}}, "'still' takes no variant"),
            ({"plant": {"kind": "still", "switches": {"gian": 1}}}, "did you mean 'gain'"),
            ({"plant": {"kind": "still", "switches": {"sensor_bias": {"size": 1}}}}, "no parameter 'size'"),
        ],
    )
    def test_what_does_not_fit_the_arm_is_told_before_any_port_opens(self, change, told):
        async def main():
            async with running(check_scenario({**TABLE, **change})):
                raise AssertionError

        with pytest.raises(InputError) as caught:
            warp(main)
        assert told in str(caught.value)

    def test_ports_and_links_that_cannot_be_had(self, tmp_path):
        (tmp_path / "gauge").write_text("precious")
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            cases = [
                (
                    {"device": [{"name": "valves", "kind": "festo_mpa", "port": port}]},
                    "address already in use",
                ),
                ({"runtime_dir": tmp_path}, "is in the way"),
                ({"runtime_dir": tmp_path / "gauge"}, "runtime_dir"),
            ]
            for change, told in cases:

                async def main(change=change):
                    async with running(check_scenario({**TABLE, **change})):
                        raise AssertionError

                with pytest.raises(InputError) as caught:
                    warp(main)
                assert told in str(caught.value)
        assert (tmp_path / "gauge").read_text() == "precious"

    def test_scripted_faults_come_and_go(self):
        faults = [
            {"at_s": 0.2, "device": "qtm", "fault": "all_lost", "for_s": 0.3},
            {"at_s": 0.4, "device": "qtm", "fault": "all_lost", "for_s": 0.5},
            {"at_s": 0.1, "device": "gauge", "fault": "unplug"},
        ]

        async def main():
            async with running(check_scenario({**TABLE, "fault": faults})) as rig:
                board, on = rig.boards["qtm"], []
                for time in (0.15, 0.3, 0.6, 0.8, 1.0):
                    await rig.clock.sleep_until(time)
                    on.append(board.active("all_lost") is not None)
                return on, rig.serial_ports["gauge"].link.exists()

        assert warp(main) == ([False, True, True, True, False], False)


class TestFaults:
    @pytest.fixture
    def board(self):
        limits = {"seconds": (0, 1), "who": ("a", "b")}
        return FaultBoard("it", [
            Fault("slow", "late", False, {"seconds": 0.1, "who": "a"}, limits),
            Fault("trip", "once", once=True),
        ])  # fmt: skip

    def test_lasting_and_striking(self, board):
        heard = []
        board.listen(lambda name, active: heard.append((name, active)))
        board.set("slow", {"seconds": 0.5})
        board.set("trip", times=2)
        assert board.hit("slow")["seconds"] == 0.5
        assert board.active("trip")
        assert board.hit("trip")
        assert board.hit("trip")
        assert board.hit("trip") is None
        board.clear()
        assert board.hit("slow") is None
        assert board.counts == {"slow": 1, "trip": 2}
        assert heard == [("slow", True), ("trip", True), ("trip", False), ("slow", False)]

    @pytest.mark.parametrize(
        ("arguments", "told"),
        [
            (("slo",), "did you mean 'slow'"),
            (("slow", {"second": 1.0}), "did you mean 'seconds'"),
            (("slow", {"seconds": 2.0}), "give 0 to 1"),
            (("slow", {"seconds": "long"}), "give a value like 0.1"),
            (("slow", {"seconds": True}), "give a value like 0.1"),
            (("slow", {"who": "a,c"}), "'c'"),
            (("trip", {"x": 1}), "it takes none"),
            (("trip", {}, 0), "times = 0"),
        ],
    )
    def test_mistakes(self, board, arguments, told):
        with pytest.raises(InputError) as caught:
            board.set(*arguments)
        assert told in str(caught.value)
        assert board.snapshot() == {"active": {}, "counts": {}}


class TestWorld:
    def test_it_catches_up_in_turns(self):
        world = FakeArmWorld(StillArm(), None, (), 0.002)
        assert not world.advance(1.0, most=100)
        assert world.time == pytest.approx(0.2)
        assert world.advance(0.3)
        assert world.state.time == pytest.approx(0.3)

    @pytest.mark.parametrize("step_s", [0.001, 0.02])
    def test_it_keeps_to_the_clock_whatever_its_step(self, step_s):
        async def main():
            async with running(check_scenario({**TABLE, "step_s": step_s})) as rig:
                await asyncio.sleep(0.5)
                return rig.clock.now() - rig.world.time

        assert 0.0 <= warp(main) <= 1.1 * step_s + 0.002

    def test_hand_and_cord_are_checked(self):
        world = FakeArmWorld(StillArm(), None, (), 0.002)
        for wrong in (Hand("nose"), Hand("tip", force=(float("nan"), 0.0, 0.0))):
            with pytest.raises(InputError):
                world.hold(wrong)
        with pytest.raises(InputError):
            world.tie(Cord("tip", (0.0, 0.0, float("inf")), 1.0))
        world.hold(Hand("tip", force=(1.0, 0.0, 0.0)))
        world.advance(0.01)
        assert world.state.external_forces[2] == pytest.approx([1.0, 0.0, 0.0])

    def test_a_stage_moves_the_hook_of_a_tied_cord(self):
        world = FakeArmWorld(StillArm(), None, (), 0.002)
        world.tie(Cord("tip", (0.3, 0.0, 0.3), 0.3))
        assert world.cord.hook == (0.3, 0.0, 0.3)
        goal = Cord("tip", (0.3, 0.004, 0.303), 0.3)
        world.tie(goal)
        world.advance(0.1)
        moved = np.array(world.cord.hook) - (0.3, 0.0, 0.3)
        assert moved == pytest.approx([0.0, 0.0016, 0.0012])
        world.advance(0.26, most=100)
        assert world.cord == goal
        world.tie(None)
        assert world.cord is None


class TestControl:
    def test_requests(self):
        async def main():
            async with running(check_scenario({**TABLE, "control_port": 0})) as rig:

                def ask(**request):
                    return serve(rig, json.dumps(request).encode())

                assert ask(
                    do="fault", id=7, device="qtm", fault="body_lost", parameters={"bodies": "tip"}, for_s=0.2
                ) == {"id": 7, "ok": True}
                told = ask(do="status")
                assert [device["name"] for device in told["devices"]] == ["valves", "qtm", "gauge"]
                assert told["devices"][1]["active"] == {"body_lost": {"bodies": "tip"}}
                assert told["devices"][2]["source"].startswith("fake+serial://")
                await asyncio.sleep(0.25)
                assert ask(do="status")["devices"][1]["active"] == {}
                assert ask(do="cord", section="tip", hook_m=[0, 0, -0.5], length_m=0.2)["ok"]
                assert ask(do="hand", section="intermediate", force_n=[0, 2, 0])["ok"]
                await asyncio.sleep(0.1)
                truth = ask(do="truth")
                assert truth["cord_force"] == pytest.approx(20.0)
                assert truth["external_forces"][1] == [0.0, 2.0, 0.0]
                assert ask(do="cord")["ok"]
                assert ask(do="hand")["ok"]
                await asyncio.sleep(0.1)
                assert ask(do="truth")["cord_force"] == 0.0
                assert ask(do="switch", effect="gain", value=2e-5)["ok"]
                assert ask(do="clear", device="qtm")["ok"]
                assert ask(do="clear")["ok"]
                assert {f["fault"] for f in ask(do="catalogue")["faults"]["gauge"]} >= {
                    "unplug",
                    "over_range",
                }

        warp(main)

    @pytest.mark.parametrize(
        ("request_line", "told"),
        [
            (b"{}", "do"),
            (b"nonsense", "not a JSON object"),
            (b"[1]", "not a JSON object"),
            (b'{"do": "explode"}', "explode"),
            (b'{"do": "fault", "device": "qtm"}', "fault"),
            (b'{"do": "fault", "device": "qtn", "fault": "x"}', "did you mean 'qtm'"),
            (b'{"do": "fault", "device": "qtm", "fault": "shut"}', "no fault 'shut'"),
            (b'{"do": "clear", "device": "nobody"}', "no device"),
            (b'{"do": "cord", "section": "nose"}', "no section"),
            (b'{"do": "switch", "effect": "x"}', "no effect"),
            (b'{"do": "status", "more": 1}', "more"),
        ],
    )
    def test_mistakes_are_answered(self, request_line, told):
        async def main():
            async with running(check_scenario(TABLE)) as rig:
                return serve(rig, request_line)

        answer = warp(main)
        assert answer["ok"] is False
        assert told in answer["error"]

    def test_the_port_serves_lines_and_closes(self):
        async def main():
            async with running(check_scenario(TABLE)) as rig:
                control = ControlPort(rig, 0)
                await control.start()
                reader, writer = await asyncio.open_connection("127.0.0.1", control.port)
                writer.write(b'{"do": "status"}\n{"do": "truth", "id": "x"}\n')
                answers = [json.loads(await reader.readline()) for _ in range(2)]
                await control.stop()
                assert await reader.read() == b""
                writer.close()
                return answers

        status, truth = warp(main)
        assert status["ok"]
        assert truth["ok"]
        assert truth["id"] == "x"


class TestConcealed:
    def test_effects_of_sensors_and_valves_show_in_what_is_seen_only(self):
        async def main():
            table = {**TABLE, "plant": {"kind": "still", "switches": {
                "sensor_bias": {"where": {"sensor": "frame_tip"}, "angle": 0.1},
                "valve_deadband": {"width": 4e3},
            }}}  # fmt: skip
            async with running(check_scenario(table)) as rig:
                node = rig.valve_ports["valves"].node
                node.write(40003, [100, 200] + 14 * [0])
                await asyncio.sleep(1.5)
                seen = rig.qtm_servers["qtm"].last_frame.bodies
                return node.pressures(), seen, rig.state

        pressures, seen, state = warp(main)
        assert 4.5e3 < pressures[0] < 6e3
        assert 14.5e3 < pressures[1] < 16e3
        for body, section in zip(seen, range(3), strict=True):
            assert np.array(body.position) == pytest.approx(1e3 * state.positions[section], abs=0.3)
        w, x, y, z = state.quaternions[2]
        down = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z])
        angle = np.arccos(np.clip(down @ np.array(seen[2].rotation[6:]), -1, 1))
        assert angle == pytest.approx(0.1, abs=0.005)

    def test_an_effect_can_be_switched_off_again(self):
        async def main():
            async with running(check_scenario(TABLE)) as rig:
                rig.switch("sensor_bias", {"where": {"sensor": "gauge_cord"}, "offset": 3.0})
                value = np.array([1.0])
                on = rig.signals.apply("gauge", "gauge_cord", 0.0, value)
                rig.switch("sensor_bias", None)
                return on, rig.signals.apply("gauge", "gauge_cord", 0.1, value)

        on, off = warp(main)
        assert on == pytest.approx([4.0])
        assert off == [1.0]


class TestWarpLoop:
    def test_waiting_is_short_and_the_clock_right(self):
        async def main():
            loop = asyncio.get_running_loop()
            begin = loop.time()
            await asyncio.gather(*(asyncio.sleep(k) for k in (1.0, 5.0, 20.0)))
            return loop.time() - begin

        assert warp(main) == pytest.approx(20.0, abs=0.1)

    def test_work_takes_no_virtual_time(self):
        async def main():
            loop = asyncio.get_running_loop()
            begin = loop.time()
            for _ in range(3):
                sum(range(300_000))
                await asyncio.sleep(0)
            return loop.time() - begin

        assert warp(main) == pytest.approx(0.0, abs=1e-6)

    def test_work_on_a_thread_takes_no_more_virtual_than_real_time(self):
        async def main():
            loop = asyncio.get_running_loop()
            begin = loop.time()
            async with asyncio.timeout(3.0):
                await asyncio.to_thread(time.sleep, 0.2)
            took = loop.time() - begin
            await asyncio.sleep(20.0)
            return took, loop.time() - begin

        took, all_in_all = warp(main)
        assert 0.1 < took < 3.0
        assert all_in_all == pytest.approx(20.0 + took, abs=0.1)
