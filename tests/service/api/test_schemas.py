from jsonschema import Draft202012Validator

from acceptance.reference.api import example_request, limits
from acceptance.reference.api_examples import EXAMPLES
from softarm.daemon.network.schemas import schemas
from softarm_client.commands import VERBS, TeachSave


def test_every_verb_has_a_schema():
    requests = schemas()["requests"]
    assert set(requests) == {f"command/{verb}" for verb in VERBS}
    for schema in requests.values():
        Draft202012Validator.check_schema(schema)


def test_every_verb_has_an_example_that_its_own_model_accepts():
    assert set(EXAMPLES) == set(VERBS)
    for verb, model in VERBS.items():
        request = model.model_validate(example_request(verb))
        unset = set(model.model_fields) - request.model_fields_set
        assert not {name for name in unset if model.model_fields[name].is_required()}


def test_the_pattern_of_a_name_keeps_its_letters():
    assert limits(TeachSave.model_fields["name"]).endswith("pattern `^[A-Za-z0-9_.-]+$`.")
