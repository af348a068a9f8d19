import pytest

from app.settings import SettingsError, read_settings

TOKEN = "0123456789abcdef"


def test_only_this_machine_can_reach_the_server_unless_told_otherwise():
    settings = read_settings({})
    assert settings.host == "127.0.0.1"
    assert settings.is_local
    assert settings.token is None


def test_options_go_over_the_environment(tmp_path):
    environment = {"FOREWARN_PORT": "9000", "FOREWARN_DATA_DIR": str(tmp_path)}
    settings = read_settings(environment, port=9001, host=None)
    assert (settings.port, settings.host, settings.data_dir) == (9001, "127.0.0.1", tmp_path)
    assert settings.url == f"sqlite:///{tmp_path / 'forewarn.db'}"


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.7", "control-room.example"])
def test_an_address_that_others_reach_needs_a_token(host):
    with pytest.raises(SettingsError, match="FOREWARN_TOKEN"):
        read_settings({}, host=host)
    assert not read_settings({"FOREWARN_TOKEN": TOKEN}, host=host).is_local


@pytest.mark.parametrize("host", ["127.0.0.1", "127.3.2.1", "::1", "localhost"])
def test_an_address_of_this_machine_needs_none(host):
    assert read_settings({}, host=host).is_local


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"FOREWARN_PORT": "eight"}, "FOREWARN_PORT='eight': give an integer"),
        ({"FOREWARN_PORTS": "8000"}, "FOREWARN_PORTS is not a setting: choose FOREWARN_DATA_DIR"),
        ({"FOREWARN_PORT": "70000"}, "port=70000"),
        ({"FOREWARN_REAL_TIME": "yes"}, "FOREWARN_REAL_TIME='yes': give 0 or 1"),
        *(
            ({"FOREWARN_SHARED": wrong}, f"shared='{wrong}': give the address at which")
            for wrong in ("range-1", "ftp://x:1", "http://x", "http://x:1/a", "https://x:1")
        ),
        ({"FOREWARN_TOKEN": "short"}, "at least 16"),
        ({"FOREWARN_TOKEN": "a token with é in it"}, "ASCII"),
        ({"FOREWARN_ALLOWED_ORIGINS": "*"}, "allowed_origins has '\\*': give scheme, host"),
        ({"FOREWARN_ALLOWED_ORIGINS": "https://range/"}, "allowed_origins has 'https://range/'"),
        ({"FOREWARN_MAX_JOBS": "-1"}, "max_jobs=-1"),
        ({"FOREWARN_MAX_BODY_BYTES": "0"}, "max_body_bytes=0"),
        ({"FOREWARN_MAX_HEADER_BYTES": "1"}, "max_header_bytes=1"),
        ({"FOREWARN_HEADER_SECONDS": "0"}, "header_seconds=0"),
        ({"FOREWARN_BODY_SECONDS": "nan"}, "body_seconds=nan"),
        ({"FOREWARN_IDLE_SECONDS": "soon"}, "IDLE_SECONDS='soon': give a number"),
    ],
)
def test_a_setting_that_cannot_be_used_says_so(environment, words):
    with pytest.raises(SettingsError, match=words):
        read_settings(environment)


def test_secrets_are_not_printed():
    settings = read_settings({"FOREWARN_TOKEN": TOKEN, "FOREWARN_DATABASE_URL": "pg://me:pw@x/y"})
    assert TOKEN not in repr(settings)
    assert "pw@" not in repr(settings)


def test_a_control_room_of_fifty_flights_needs_no_setting():
    assert read_settings({}).max_flights >= 50
