"""The control port of a rig: faults, cord, hand and switches at run time, one JSON object per line."""

import asyncio
import dataclasses
import json
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from softarm.estimator.errors import InputError
from softarm.fakes.faults import nearest
from softarm.fakes.parts import ConfigTable, NotNegative, Positive, ValvesPart, Vector
from softarm.fakes.plant.state import Cord, Hand
from softarm.fakes.rig import Rig
from softarm.fakes.scenario import Parameter

LONGEST_LINE = 65536


class FaultRequest(ConfigTable):
    """Switch a fault on; with ``for_s`` it goes off again by itself."""

    do: Literal["fault"]
    device: str
    fault: str
    parameters: Annotated[dict[str, Parameter], Field(default_factory=dict)]
    times: Annotated[int, Field(ge=1)] = 1
    for_s: Positive | None = None


class ClearRequest(ConfigTable):
    """Switch off one fault, all of one device, or all."""

    do: Literal["clear"]
    device: str | None = None
    fault: str | None = None


class CordRequest(ConfigTable):
    """Tie the cord of the gauge to a section, or take it off when no section is named."""

    do: Literal["cord"]
    section: str | None = None
    hook_m: Vector = (0.0, 0.0, 0.0)
    length_m: NotNegative = 0.0


class HandRequest(ConfigTable):
    """Put a hand on a section, or take it away when no section is named."""

    do: Literal["hand"]
    section: str | None = None
    force_n: Vector = (0.0, 0.0, 0.0)
    position_m: Vector = (0.0, 0.0, 0.0)
    stiffness_n_per_m: NotNegative = 0.0


class SwitchRequest(ConfigTable):
    """Set a concealed effect of the arm, of the valves or of a sensor."""

    do: Literal["switch"]
    effect: str
    value: Any = None


class AskRequest(ConfigTable):
    """Request the endpoints and fault counts, the true state of the arm, or the faults that there are."""

    do: Literal["status", "truth", "catalogue"]


Request = FaultRequest | ClearRequest | CordRequest | HandRequest | SwitchRequest | AskRequest
REQUEST: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def serve(rig: Rig, line: bytes) -> dict[str, Any]:
    """Serve one request.

    Args:
        rig: The running fakes.
        line: One JSON object; an ``id`` in it comes back in the reply.

    Returns:
        The reply: ``ok`` and the result, or ``ok`` false and ``error``.
    """
    try:
        request = json.loads(line)
    except ValueError:
        return {"ok": False, "error": "not a JSON object"}
    if not isinstance(request, dict):
        return {"ok": False, "error": "not a JSON object"}
    echo = {"id": request.pop("id")} if "id" in request else {}
    try:
        return {**echo, "ok": True, **_act(rig, REQUEST.validate_python(request, strict=False))}
    except ValidationError as error:
        errors = [f"{'.'.join(map(str, entry['loc'][1:]))}: {entry['msg']}" for entry in error.errors()]
        return {**echo, "ok": False, "error": "; ".join(error.removeprefix(": ") for error in errors)}
    except InputError as error:
        return {**echo, "ok": False, "error": str(error)}


def status(rig: Rig) -> dict[str, Any]:
    """Return where the fakes can be reached and what has gone wrong so far."""
    devices = [
        {**dataclasses.asdict(endpoint), **rig.boards[endpoint.name].snapshot()}
        for endpoint in rig.endpoints()
    ]
    return {
        "scenario": rig.scenario.name,
        "time_s": rig.clock.now(),
        "world_s": rig.world.time,
        "devices": devices,
    }


def _act(rig: Rig, request: Request) -> dict[str, Any]:
    if isinstance(request, FaultRequest):
        _board(rig, request.device)
        rig.inject(request.device, request.fault, request.parameters, request.times, request.for_s)
    elif isinstance(request, ClearRequest):
        names = list(rig.boards) if request.device is None else [request.device]
        for name in names:
            _board(rig, name).clear(request.fault)
    elif isinstance(request, CordRequest):
        section = request.section
        rig.world.tie(Cord(section, request.hook_m, request.length_m) if section else None)
    elif isinstance(request, HandRequest):
        numbers = request.force_n, request.position_m, request.stiffness_n_per_m
        rig.world.hold(Hand(request.section, *numbers) if request.section else None)
    elif isinstance(request, SwitchRequest):
        rig.switch(request.effect, request.value)
    else:
        answers: dict[str, Callable[[Rig], dict[str, Any]]] = {
            "status": status, "truth": _truth, "catalogue": _catalogue
        }  # fmt: skip
        return answers[request.do](rig)
    return {}


def _board(rig: Rig, device: str) -> Any:
    if device not in rig.boards:
        raise InputError("fakes", f"no device {device!r}", nearest(device, rig.boards))
    return rig.boards[device]


def _truth(rig: Rig) -> dict[str, Any]:
    state = rig.state
    fields = {field.name: getattr(state, field.name) for field in dataclasses.fields(state)}
    plain = {name: value if isinstance(value, float) else value.tolist() for name, value in fields.items()}
    setpoints = {
        part.name: [rig.valve_ports[part.name].node.setpoint(valve) for valve in part.valve_map]
        for part in rig.scenario.device
        if isinstance(part, ValvesPart)
    }
    return {
        "sections": rig.plant.sections,
        "segments": rig.plant.segments,
        "setpoints_mbar": setpoints,
        **plain,
    }


def _catalogue(rig: Rig) -> dict[str, Any]:
    faults = {
        name: [
            {"fault": f.name, "text": f.text, "once": f.once, "parameters": dict(f.parameters)}
            for f in board.catalogue.values()
        ]
        for name, board in rig.boards.items()
    }
    return {"faults": faults}


class ControlPort:
    """Serves requests on a TCP port of this machine.

    Args:
        rig: The running fakes.
        port: TCP port, 0 for a free one.
    """

    def __init__(self, rig: Rig, port: int) -> None:
        self.port = port
        self._rig = rig
        self._writers: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None

    async def start(self) -> None:
        """Listen; ``port`` then holds the number."""
        self._server = await asyncio.start_server(self._converse, "127.0.0.1", self.port, limit=LONGEST_LINE)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Close the port and its connections."""
        if self._server is not None:
            self._server.close()
        for writer in self._writers:
            writer.close()
        await asyncio.sleep(0)  # lets the transports close before the loop ends

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        try:
            while line := await reader.readline():
                writer.write(json.dumps(serve(self._rig, line)).encode() + b"\n")
                await writer.drain()
        except (ValueError, ConnectionError):
            return
        finally:
            self._writers.discard(writer)
            writer.close()
