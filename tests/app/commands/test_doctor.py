import json

import pytest
from sqlalchemy import text

from app.cli import main
from app.commands import doctor
from app.commands.doctor import Failed, examine
from app.settings import Settings
from app.store.store import StoreError, open_store


@pytest.fixture
def settings(tmp_path):
    return Settings(data_dir=tmp_path / "data", port=0)


def test_a_sound_installation_passes(settings):
    findings = {finding.what: finding for finding in examine(settings)}
    assert [f"{finding}" for finding in findings.values() if not finding.is_well] == []
    assert list(findings)[-1] == "server"
    assert "numpy" in findings["versions"].words


def test_a_failure_does_not_stop_the_other_checks(settings, monkeypatch):
    def broken(_):
        raise RuntimeError("no such thing")

    monkeypatch.setattr(doctor, "data_directory", broken)
    monkeypatch.setattr(doctor, "round_trip", lambda _: "served")
    findings = list(examine(settings))
    assert [finding.what for finding in findings if not finding.is_well] == ["data directory"]
    (failure,) = (finding for finding in findings if finding.what == "data directory")
    assert "no such thing" in str(failure)
    assert str(failure).startswith("FAIL")


@pytest.mark.parametrize(("fails", "code"), [(False, 0), (True, 1)])
def test_the_command_succeeds_only_if_all_checks_pass(tmp_path, monkeypatch, capsys, fails, code):
    def round_trip(_):
        if fails:
            raise Failed("cannot fly")
        return "flies"

    monkeypatch.setattr(doctor, "round_trip", round_trip)
    assert main(["doctor", "--data-dir", str(tmp_path), "--port", "0"]) == code
    assert ("cannot fly" if fails else "flies") in capsys.readouterr().out


def test_the_findings_are_printed_as_json(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(doctor, "round_trip", lambda _: "flies")
    assert main(["doctor", "--data-dir", str(tmp_path), "--port", "0", "--json"]) == 0
    findings = json.loads(capsys.readouterr().out)["findings"]
    assert findings[-1] == {"what": "server", "is_well": True, "words": "flies"}


def test_a_data_directory_that_cannot_be_written_fails(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(Failed, match="--data-dir"):
        doctor.data_directory(Settings(data_dir=tmp_path / "file"))


def test_the_check_creates_no_database(settings):
    assert "no database yet" in doctor.schema(settings)
    assert not settings.data_dir.exists()


def test_a_database_of_this_program_passes(settings):
    settings.data_dir.mkdir()
    open_store(settings.url).close()
    assert "the newest" in doctor.schema(settings)


def test_a_database_of_a_newer_program_fails(settings):
    settings.data_dir.mkdir()
    store = open_store(settings.url)
    with store.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    store.close()
    with pytest.raises(StoreError, match="9999"):
        doctor.schema(settings)
