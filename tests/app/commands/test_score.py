"""`forewarn score`: files of flights, real ones among them, scored by stored monitors."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.monitor import Monitor, load
from tests.support.attas import TEST, fly, record_file
from tests.support.recorded import HEAD as HEAD_OF_FLIGHT
from tests.support.recorded import csv_of

pytestmark = pytest.mark.usefixtures("read_here")
HEAD = "t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad"


@pytest.fixture(scope="module")
def attas_monitor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train, by the command line, a monitor for the real records."""
    path = tmp_path_factory.mktemp("monitor") / "attas.fwm"
    arguments = ["--aircraft", "attas_id_16kft", "--states", "4", "--control-law", "none"]
    arguments += ["--amplitude", "-3.7", "--n-unsafe", "200", "--guarantee", "average"]
    arguments += ["--n-test", "200"]
    assert main(["train", *arguments, "-o", str(path)]) == 0
    return path


def test_wrong_units_are_reported_as_outside_training(attas_monitor: Path, tmp_path, capsys):
    rows = [f"{0.05 * k:.2f},{0.01 * k:.3f},{rest(k)},0,0" for k in range(100)]
    (tmp_path / "units.csv").write_text("\n".join([HEAD, *rows]))
    arguments = ["score", str(attas_monitor), str(tmp_path / "units.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    report = capsys.readouterr().out
    assert "No control input detected" in report
    assert re.search(r"INVALID +units: beta peaks at 5\d\.\d deg, 1\d\S* times its", report)
    assert "Guarantee withdrawn" in report


def test_the_outcome_is_unknown_where_a_limited_channel_is_missing(attas_monitor, tmp_path, capsys):
    text = record_file("attas_rud1").read_text().splitlines()
    names = text[0].split(",")
    rows = [line.split(",") for line in text[1:]]
    for row in rows[200:231]:
        row[names.index("ay_g")] = ""
    (tmp_path / "holes.csv").write_text("\n".join([text[0], *(",".join(row) for row in rows)]))
    arguments = ["score", str(attas_monitor), str(tmp_path / "holes.csv"), "--trim", "4"]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    assert "1.24 s missing in the limited channels" in capsys.readouterr().out


def test_a_truncated_monitor_file_is_refused(attas_monitor: Path, tmp_path: Path, capsys):
    broken = tmp_path / "broken.fwm"
    broken.write_bytes(attas_monitor.read_bytes()[:-100])
    assert main(["score", str(broken), "any.csv", "-o", str(tmp_path / "out")]) == 1
    assert "cut off or altered" in capsys.readouterr().err


def test_a_real_doublet_that_exceeds_the_limit_is_warned_of(attas_monitor: Path, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [str(attas_monitor), str(record_file("attas_rud1")), "-o", str(out)]
    assert main(["score", *arguments]) == 0
    report = capsys.readouterr().out
    assert "beta     beta_rad [rad]" in report
    assert "from 25 Hz to 20 Hz" in report
    assert "manoeuvre 1, 5.50 to 11.50 s: LIMIT EXCEEDED, warned " in report
    assert "begins 6.00 s (trim from 5.50 s)" in report
    assert "exceedance         at 8.76 s" in report
    assert "at least the promised 0.25 s" in report
    assert "for flights like the simulated ones" in report
    assert "limit exceeded" in (out / "scored.svg").read_text()
    assert not (out / "scored.png").exists()
    rows = read_table(out)
    of_first = [row["state"] for row in rows if row["manoeuvre"] == "0"]
    assert set(of_first[of_first.index("ok") :]) == {"ok"}
    assert {row["state"] for row in rows if row["manoeuvre"] == "-1"} == {"invalid"}
    first = next(float(row["t_s"]) for row in rows if row["alert"] == "true")
    assert f"first alert        at {first:.2f} s" in report


def test_a_real_record_of_another_manoeuvre_gets_no_verdict(attas_monitor: Path, tmp_path, capsys):
    arguments = [str(attas_monitor), str(record_file("attas_ail1")), "-o", str(tmp_path / "out")]
    assert main(["score", *arguments]) == 0
    report = capsys.readouterr().out
    assert "INVALID, no verdict" in report
    assert "first alert        INVALID" in report
    assert "aileron moved by 14 deg, although the planned manoeuvre does not use it" in report
    rows = read_table(tmp_path / "out")
    assert all(row["p_value"] == "" and row["alert"] == "false" for row in rows)
    assert sum(row["withdrawn_p_value"] != "" for row in rows) > 121


def test_a_second_scoring_writes_the_same_bytes(attas_monitor: Path, tmp_path: Path):
    for name in ("one", "two"):
        arguments = [str(attas_monitor), str(record_file("attas_rud1")), "-o", str(tmp_path / name)]
        assert main(["score", *arguments]) == 0
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name


def test_assessments_of_a_scored_file_can_be_scored_again(attas_monitor: Path, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    base = ["score", str(attas_monitor)]
    assert main([*base, str(record_file("attas_rud1")), "-o", str(first)]) == 0
    again = [str(first / "assessments.csv"), "--trim", "none", "-o", str(second)]
    assert main([*base, *again]) == 0
    one, two = (
        [row for row in read_table(folder) if row["manoeuvre"] == "0"] for folder in (first, second)
    )
    assert one == two


def test_a_written_mapping_can_be_corrected_and_used(attas_monitor: Path, tmp_path, capsys):
    base = ["score", str(attas_monitor), str(record_file("attas_rud1"))]
    assert main([*base, "-o", str(tmp_path / "out")]) == 0
    mapping = json.loads((tmp_path / "out" / "mapping.json").read_text())
    assert mapping["channels"]["delta_r"]["signal"] == "dr_rad"
    mapping["channels"]["delta_r"]["sign"] *= -1
    (tmp_path / "mine.json").write_text(json.dumps(mapping))
    given = ["--mapping", str(tmp_path / "mine.json"), "-o", str(tmp_path / "reversed")]
    capsys.readouterr()
    assert main([*base, *given]) == 0
    report = capsys.readouterr().out
    assert "given mapping:" in report
    assert "-dr_rad [rad]" in report
    assert "moved the other way first, or its sign is reversed" in report
    assert json.loads((tmp_path / "reversed" / "mapping.json").read_text()) == mapping


def test_raw_counts_are_scored_by_the_scale_in_the_mapping(attas: Monitor, tmp_path, capsys):
    y, names = np.concatenate(fly(2, 5).y), [f"word {k}" for k in range(1, 7)]
    (tmp_path / "plain.csv").write_bytes(csv_of(y, TEST.dt))
    (tmp_path / "counts.csv").write_bytes(csv_of(y * 2**14, TEST.dt, ",".join(["t_s", *names])))
    attas.save(tmp_path / "attas.fwm")
    base = ["score", str(tmp_path / "attas.fwm")]
    assert main([*base, str(tmp_path / "plain.csv"), "-o", str(tmp_path / "out")]) == 0
    mapping = json.loads((tmp_path / "out" / "mapping.json").read_text())
    of_name = dict(zip(HEAD_OF_FLIGHT.split(",")[1:], names, strict=True))
    for source in mapping["channels"].values():
        source |= {"signal": of_name[source["signal"]], "scale": 2**-14}
    given = ["--mapping", str(tmp_path / "mine.json"), "-o", str(tmp_path / "counted")]
    (tmp_path / "mine.json").write_text(json.dumps(mapping))
    capsys.readouterr()
    assert main([*base, str(tmp_path / "counts.csv"), *given]) == 0
    assert "word 1 = 6.103515625e-05 * raw [rad]" in capsys.readouterr().out
    assert read_table(tmp_path / "counted") == read_table(tmp_path / "out")
    mapping["channels"]["beta"]["scale"] = 0.0
    (tmp_path / "mine.json").write_text(json.dumps(mapping))
    assert main([*base, str(tmp_path / "counts.csv"), *given]) == 1
    assert "the mapping of 'beta' has a scale of 0" in capsys.readouterr().err


def test_an_aircrafts_mapping_is_used_for_its_next_file(
    attas_monitor: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    monkeypatch.setenv("FOREWARN_DATA_DIR", str(tmp_path / "data"))
    base = ["score", str(attas_monitor), str(record_file("attas_rud1")), "--aircraft", "D-ADAM"]
    assert main([*base, "-o", str(tmp_path / "out")]) == 0
    mapping = json.loads((tmp_path / "out" / "mapping.json").read_text())
    mapping["channels"]["Ny"]["bias"] = 0.125
    mapping["channels"]["delta_a"]["bias"] = 0.1
    (tmp_path / "mine.json").write_text(json.dumps(mapping))
    given = ["--mapping", str(tmp_path / "mine.json"), "-o", str(tmp_path / "given")]
    assert main([*base, *given]) == 0
    capsys.readouterr()
    assert main([*base, "-o", str(tmp_path / "next")]) == 0
    report = capsys.readouterr().out
    assert "bias removed: 0.125 g" in report
    assert "bias removed: 5.73 deg" in report
    assert json.loads((tmp_path / "next" / "mapping.json").read_text()) == mapping


def test_each_monitor_and_epsilon_gets_its_own_files(attas_monitor: Path, tmp_path: Path, capsys):
    copy = tmp_path / attas_monitor.name
    copy.write_bytes(attas_monitor.read_bytes())
    arguments = [str(attas_monitor), str(copy), str(record_file("attas_rud1"))]
    arguments += ["--epsilon", "0.1,0.5", "-o", str(tmp_path / "out")]
    assert main(["score", *arguments]) == 0
    report = capsys.readouterr().out
    labels = [f"{name}-epsilon-{e}" for name in ("attas", "attas-2") for e in ("0.1", "0.5")]
    assert re.findall(r"^== (.*) ==$", report, re.MULTILINE) == labels
    tables = {label: read_table(tmp_path / "out" / label) for label in labels}
    assert tables["attas-epsilon-0.5"] == tables["attas-2-epsilon-0.5"]
    p_values = {tuple(row["p_value"] for row in table) for table in tables.values()}
    assert len(p_values) == 1
    assert (tmp_path / "out" / "mapping.json").exists()


def test_a_useless_monitor_scores_alone_only_with_accept_useless(
    attas_monitor: Path, tmp_path: Path, capsys
):
    tested = load(attas_monitor)
    counts = {"misses": 0, "false_alerts": 3980, "withdrawn": 0}
    evaluation = {**(tested.evaluation or {}), "n_safe": 4000, "at_epsilon": counts}
    useless = tmp_path / "useless.fwm"
    replace(tested, evaluation=evaluation).save(useless)
    arguments = [str(useless), str(record_file("attas_rud1")), "-o", str(tmp_path / "out")]
    assert main(["score", *arguments]) != 0
    said = capsys.readouterr().err
    assert "useless.fwm: the monitor is of no use: only " in said
    assert "accept a useless monitor: --accept-useless" in said
    assert not (tmp_path / "out").exists()
    assert main(["score", *arguments, "--accept-useless", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["accept_useless"] is True
    assert any("of no use" in warning for warning in told["scorings"][0]["warnings"])
    beside = [str(useless), str(attas_monitor), str(record_file("attas_rud1"))]
    assert main(["score", *beside, "-o", str(tmp_path / "both")]) == 0


def test_manoeuvres_are_scored_between_given_times(attas_monitor: Path, tmp_path, capsys):
    arguments = [str(attas_monitor), str(record_file("attas_rud1")), "-o", str(tmp_path / "out")]
    assert main(["score", *arguments, "--manoeuvres", "5:11,20:26"]) == 0
    report = capsys.readouterr().out
    assert "manoeuvre 1, 5.00 to 11.00 s" in report
    assert "manoeuvre 2, 20.00 to 26.00 s" in report
    out = ["--manoeuvres", "20:40", "-o", str(tmp_path / "no")]
    assert main(["score", *arguments[:2], *out]) == 1
    assert "20 to 40 s is not inside the recording" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_an_error_names_the_missing_channel(attas_monitor: Path, tmp_path: Path, capsys):
    text = record_file("attas_rud1").read_text().replace("beta_rad", "alpha2_rad")
    (tmp_path / "flight.csv").write_text(text)
    arguments = ["score", str(attas_monitor), str(tmp_path / "flight.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 1
    *signals, error = capsys.readouterr().err.strip().splitlines()
    assert f"{tmp_path / 'flight.csv'}: the monitor needs beta" in error
    assert "or choose a monitor that does not need them" in error
    assert signals[0] == "signals of the file: 12"
    assert "    alpha2_rad" in signals
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mapping.json"]


def test_bad_rows_are_skipped_and_listed(attas_monitor: Path, tmp_path: Path, capsys):
    lines = record_file("attas_rud1").read_text().splitlines()
    lines[300] = lines[300].replace(",", ",x", 1)
    (tmp_path / "bad.csv").write_text("\n".join(lines))
    arguments = ["score", str(attas_monitor), str(tmp_path / "bad.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    report = capsys.readouterr().out
    assert "bad rows skipped: 1" in report
    assert "line 301:" in report


def test_the_samples_not_assessed_in_gaps_are_counted(attas_monitor: Path, tmp_path, capsys):
    lines = [f"{0.05 * k:.2f},{1e-4 * (k % 3)},{rest(k)},0,0" for k in range(40)]
    lines[10] = "0.5,nan,nan,nan,nan,nan,nan"
    (tmp_path / "gap.csv").write_text("\n".join([HEAD, *lines]))
    arguments = ["score", str(attas_monitor), str(tmp_path / "gap.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    assert "samples: 37 ok, 2 warming_up, 0 stale, 1 invalid" in capsys.readouterr().out
    rows = read_table(tmp_path / "out")
    withdrawn = [row["withdrawn_p_value"] == "" for row in rows]
    assert withdrawn == [k in (10, 11, 12) for k in range(40)]


def test_a_file_without_an_assessed_sample_exits_with_1(attas_monitor: Path, tmp_path, capsys):
    lines = [HEAD]
    for k in range(40):
        beta, others = (1e-4 * (k % 3), ",,") if k < 20 else ("", rest(k))
        lines.append(f"{0.05 * k:.2f},{beta},{others},0,0")
    (tmp_path / "holes.csv").write_text("\n".join(lines))
    arguments = ["score", str(attas_monitor), str(tmp_path / "holes.csv")]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 1
    assert re.search(r"INVALID +coverage: no sample was assessed", capsys.readouterr().out)


def rest(k: int) -> str:
    """Roll rate, yaw rate and N_y of an aircraft that barely moves."""
    return f"{1e-4 * (k % 2)},{1e-4 * (k % 3)},{1e-3 * (k % 2)}"


def read_table(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "assessments.csv").read_text().splitlines()))
