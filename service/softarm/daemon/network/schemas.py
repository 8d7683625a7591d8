"""JSON schemas of all that goes over the network."""

from softarm_client.commands import VERBS, Applied, Refused
from softarm_client.messages import STREAMS


def schemas() -> dict[str, object]:
    """Collect the JSON schemas of every stream, request and reply, by name."""
    streams = {name: model.model_json_schema() for name, model in STREAMS.items()}
    requests = {f"command/{verb}": model.model_json_schema() for verb, model in VERBS.items()}
    replies = {model.__name__: model.model_json_schema() for model in (Applied, Refused)}
    return {"schema": "softarm.schema/1", "streams": streams, "requests": requests, "replies": replies}
