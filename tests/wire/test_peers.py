"""Independent peers: public clients of both TCP protocols read the fakes, in real time."""

import asyncio
import socket
import struct
from itertools import pairwise

import pytest
import qtm_rt
from pymodbus.client import AsyncModbusTcpClient

from softarm.fakes.rig import running
from softarm.fakes.scenario import check_scenario

QTM = {"name": "qtm", "kind": "qualisys", "rate_hz": 200.0, "discovery_port": 0}
READERS = {"6deuler": "get_6d_euler", "6dres": "get_6d_residual", "6deulerres": "get_6d_euler_residual"}
VALVES = {"name": "valves", "kind": "festo_mpa"}


def bench(*devices, **keys):
    return running(check_scenario({"plant": {"kind": "still"}, "device": list(devices), **keys}))


async def test_pymodbus_reads_and_writes_the_terminal():
    async with bench(VALVES) as rig:
        client = AsyncModbusTcpClient("127.0.0.1", port=rig.valve_ports["valves"].port, timeout=2, retries=0)
        assert await client.connect()
        answer = await client.read_holding_registers(45395, count=48)
        assert not answer.isError()
        assert len(answer.registers) == 48
        await client.write_registers(40003, [350] + 15 * [0])
        echo = []
        while echo != [300, 7]:  # the process image follows within one I/O cycle
            answer = await client.readwrite_registers(
                read_address=45395, read_count=48, write_address=40003, values=[300, 7] + 14 * [0]
            )
            assert not answer.isError()
            echo = answer.registers[1::3][:2]
        await client.write_register(46100, 30)
        assert (await client.read_holding_registers(46100, count=1)).registers == [100]
        assert (await client.read_holding_registers(50000, count=1)).exception_code == 2
        assert (await client.write_register(45395, 1)).exception_code == 2
        assert (await client.read_input_registers(45395, count=1)).exception_code == 1
        identity = await client.read_device_information()
        assert identity.information[0] == b"Festo"
        client.close()


async def test_several_modbus_clients_share_one_process_image():
    async with bench(VALVES) as rig:
        port = rig.valve_ports["valves"].port
        first, second = (AsyncModbusTcpClient("127.0.0.1", port=port, timeout=2, retries=0) for _ in range(2))
        assert await first.connect()
        assert await second.connect()
        await first.write_register(40005, 123)
        while (await second.read_holding_registers(45396 + 6, count=1)).registers != [123]:
            pass
        first.close()
        second.close()


async def test_qtm_rt_reads_the_server():
    async with bench(QTM) as rig:
        server = rig.qtm_servers["qtm"]
        connection = await qtm_rt.connect("127.0.0.1", port=server.port, version="1.25")
        assert connection is not None
        assert await connection.qtm_version() == b"QTM Version is 2.3 (build 464)"
        assert await connection.byte_order() == b"Byte order is little endian"
        assert await connection.get_state() is qtm_rt.QRTEvent.EventCaptureStarted
        xml = (await connection.get_parameters(["6d"])).decode()
        assert xml.index("<Name>base</Name>") < xml.index("<Name>tip</Name>")
        frames, enough = [], asyncio.Event()

        def on_packet(packet):
            frames.append((packet.framenumber, packet.timestamp, *packet.get_6d()))
            if len(frames) == 20:
                enough.set()

        assert await connection.stream_frames(components=["6d"], on_packet=on_packet) == b"Ok"
        await asyncio.wait_for(enough.wait(), 5)
        numbers = [number for number, *_ in frames]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        assert frames[1][1] - frames[0][1] == 5000
        header, bodies = frames[-1][2:]
        assert header.body_count == 3
        position, rotation = bodies[2]
        assert (position.x, position.y, position.z) == pytest.approx((0, 0, -290), abs=0.5)
        assert rotation.matrix == pytest.approx((1, 0, 0, 0, -1, 0, 0, 0, -1), abs=0.01)
        connection.disconnect()


@pytest.mark.parametrize("component", READERS)
async def test_qtm_rt_reads_the_other_components(component):
    async with bench(QTM) as rig:
        connection = await qtm_rt.connect("127.0.0.1", port=rig.qtm_servers["qtm"].port)
        packet = await connection.get_current_frame([component])
        while packet.framenumber == 0:
            packet = await connection.get_current_frame([component])
        bodies = getattr(packet, READERS[component])()[1]
        assert bodies[0][0].z == pytest.approx(0.0, abs=0.5)
        if "euler" in component:
            assert abs(bodies[0][1].a1) == pytest.approx(180.0, abs=0.5)
        connection.disconnect()


async def test_qtm_rt_is_told_the_truth_about_versions_and_parameters():
    async with bench({**QTM, "newest_version": "1.20"}) as rig:
        port = rig.qtm_servers["qtm"].port
        connection = await qtm_rt.connect("127.0.0.1", port=port, version="1.20")
        xml = (await connection.get_parameters(["6d"])).decode()
        assert "<Bodies>3</Bodies>" in xml
        assert "QTM_Parameters_Ver_1.20" in xml
        with pytest.raises(Exception, match="Parameters not available"):
            await connection.get_parameters(["skeleton"])
        with pytest.raises(Exception, match="Parse Error"):
            await connection.get_current_frame(["3d"])
        await connection.take_control("")
        with pytest.raises(Exception, match="already master"):
            await connection.take_control("")
        await connection.release_control()
        connection.disconnect()


async def test_the_eleventh_client_is_refused():
    async with bench(QTM) as rig:
        port = rig.qtm_servers["qtm"].port
        clients = [await qtm_rt.connect("127.0.0.1", port=port) for _ in range(10)]
        assert all(clients)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        data = await reader.read()
        assert data[4:8] == bytes(4)
        assert data[8:-1].decode() == "Connection refused. Max number of clients reached."
        writer.close()
        await writer.wait_closed()
        for client in clients:
            client.disconnect()


async def test_discovery_answers_with_the_base_port():
    async with bench(QTM) as rig:
        (endpoint,) = rig.endpoints()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))
            sock.setblocking(False)
            request = struct.pack("<II", 10, 7) + struct.pack(">H", sock.getsockname()[1])
            loop = asyncio.get_running_loop()
            await loop.sock_sendto(sock, request, ("127.0.0.1", endpoint.discovery_port))
            answer = await asyncio.wait_for(loop.sock_recv(sock, 1024), 5)
        assert struct.unpack("<II", answer[:8]) == (len(answer), 1)
        assert struct.unpack(">H", answer[-2:])[0] == endpoint.port - 1
        assert b", QTM 2.3 (build 464), " in answer


async def test_frames_by_udp():
    async with bench(QTM) as rig:
        _, writer = await asyncio.open_connection("127.0.0.1", rig.qtm_servers["qtm"].port)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))
            sock.setblocking(False)
            words = b"StreamFrames FrequencyDivisor:2 UDP:%d 6D\0" % sock.getsockname()[1]
            writer.write(struct.pack("<II", 8 + len(words), 1) + words)
            loop = asyncio.get_running_loop()
            packets = [await asyncio.wait_for(loop.sock_recv(sock, 4096), 5) for _ in range(5)]
        numbers = [struct.unpack_from("<I", packet, 16)[0] for packet in packets]
        assert [b - a for a, b in pairwise(numbers)] == [2, 2, 2, 2]
        assert {len(packet) for packet in packets} == {184}
        writer.close()
        await writer.wait_closed()
