"""Values that are each valid and do not fit together are refused, each with its field and what to write."""

import pytest

from softarm.daemon.config import ConfigError, load_config

FITS = """
arm = "a"
specimen = "sopra"
{top}
[network]
{network}
[control]
{control}
[safety]
{safety}
[[devices]]
name = "valves"
kind = "festo_mpa"
host = "127.0.0.1"
chambers = [0, 1, 2, 3, 4, 5]
maximum_pa = 65e3
{valves}
[[devices]]
name = "unit"
kind = "quaternion_line"
port = "/dev/null"
unit = 2
rate_hz = 8
[[devices]]
name = "qtm"
kind = "qualisys"
host = "127.0.0.1"
[[sensors]]
kind = "orientation"
section = "tip"
device = "unit"
{sensor}
{more}
"""
USUAL = {"sensor": "deadline_s = 0.4"}
SECOND = '[[sensors]]\nkind = "{}"\nsection = "{}"\ndevice = "qtm"\nchannel = "tip"'
USERS = '{ transport: { auth: { usrpwd: { user: "a", password: "b", dictionary_file: "users.txt" } } } }'
CERTIFICATES = "{ transport: { link: { tls: { enable_mtls: true } } } }"


def load(folder, **parts):
    keys = ("top", "network", "control", "safety", "valves", "sensor", "more")
    text = FITS.format(**(dict.fromkeys(keys, "") | USUAL | parts))
    if "maximum_pa" in parts.get("valves", "") or "chambers" in parts.get("valves", ""):
        for line in ("maximum_pa = 65e3\n", "chambers = [0, 1, 2, 3, 4, 5]\n"):
            if line.split(" ")[0] in parts["valves"]:
                text = text.replace(line, "", 1)
    path = folder / "arm.toml"
    path.write_text(text)
    return load_config(path)


def test_what_fits_is_accepted(tmp_path):
    setup = load(tmp_path, valves="maximum_pa = [65e3, 65e3, 65e3, 65e3, 65e3, 20e3]")
    assert setup.pressure_limits == (65e3,) * 5 + (20e3,)


@pytest.mark.parametrize(
    ("parts", "place", "advice"),
    [
        (
            {"valves": "maximum_pa = 200e3"},
            "devices[0] (valves).maximum_pa",
            "the specimen withstands 65000 Pa",
        ),
        (
            {"valves": "chambers = [0, 1, 2, 3]"},
            "devices[0] (valves).chambers",
            "specimen has 6 chambers",
        ),
        (
            {"control": "rate_hz = 5", "safety": "setpoint_lifetime_s = 0.1"},
            "safety.setpoint_lifetime_s",
            "write at least 0.6",
        ),
        ({"safety": "lease_s = 0.02"}, "safety.lease_s", "write at least 0.03"),
        ({"safety": "setpoint_lifetime_s = 2.0"}, "safety.setpoint_lifetime_s", "max_lifetime_s is 1 s"),
        (
            {"valves": "rate_hz = 20\nwatchdog_ms = 500", "safety": "valve_deadline_s = 0.1"},
            "safety.valve_deadline_s",
            "write at least 0.15",
        ),
        ({"sensor": "deadline_s = 0.15"}, "sensors.0.deadline_s", "write at least 0.25"),
        ({"more": SECOND.format("orientation", "tip")}, "sensors.1", "measured by sensors.0 already"),
        ({"more": SECOND.format("pose", "tip")}, "sensors.1", "measured by sensors.0 already"),
        ({"network": 'listen = ["tcp/0.0.0.0:7447"]'}, "network.listen", "allow_unauthenticated = true"),
        ({"network": 'listen = ["tcp/[::]:7447"]'}, "network.listen", "tcp/[::]:7447 lets everybody"),
        ({"network": 'listen = ["tcp/arm.lab:7447"]'}, "network.listen", "lets everybody"),
    ],
)
def test_what_does_not_fit_is_refused_with_field_and_advice(tmp_path, parts, place, advice):
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, **parts)
    assert any(line.startswith(place) and advice in line for line in caught.value.lines), caught.value.lines


def test_two_kinds_on_one_section_and_one_kind_on_two_are_no_doubles(tmp_path):
    load(tmp_path, more=SECOND.format("orientation", "intermediate"))


@pytest.mark.parametrize(
    "network",
    [
        'listen = ["tcp/127.0.0.1:7447", "tcp/localhost:7447", "tcp/[::1]:7447"]',
        'listen = ["tcp/0.0.0.0:7447"]\nallow_unauthenticated = true',
        'listen = ["tcp/0.0.0.0:7447"]\nzenoh_config = "users.json5"',
        'listen = ["tls/0.0.0.0:7447"]\nzenoh_config = "tls.json5"',
        'mode = "client"\nlisten = []\nconnect = ["tcp/router:7447"]',
    ],
)
def test_listeners_with_credentials_or_by_a_word_of_their_own_are_accepted(tmp_path, network):
    (tmp_path / "users.json5").write_text(USERS)
    (tmp_path / "tls.json5").write_text(CERTIFICATES)
    load(tmp_path, network=network)


def test_certificates_do_not_guard_a_plain_listener(tmp_path):
    (tmp_path / "tls.json5").write_text(CERTIFICATES)
    with pytest.raises(ConfigError, match="lets everybody"):
        load(tmp_path, network='listen = ["tcp/0.0.0.0:7447"]\nzenoh_config = "tls.json5"')


def test_missing_file_with_users_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"network\.zenoh_config: .*nowhere\.json5"):
        load(tmp_path, network='listen = ["tcp/0.0.0.0:7447"]\nzenoh_config = "nowhere.json5"')
