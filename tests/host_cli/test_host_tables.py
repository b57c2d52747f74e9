"""Tables of people read by the host's commands: hostile files, and the host's own exports."""

from __future__ import annotations

import codecs
import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

import esea_host
from esea_gen.errors import UserError
from esea_host.cli.app import app
from tests.tables.test_table_reader import HOSTILE

MANIFEST = "".join(
    f'[[recording]]\nfile = "t.csv"\nparticipant = "p"\ngroup = "A"\nblock = {block}\n'
    f'element = "{element}"\ntask = "x"\n'
    for block, element in ((1, "spring"), (2, "elastomer"))
)
MAPPING = "[time]\nsource = 't'\nperiod_s = 1\n[[columns]]\nsource = 'x'\nname = 'x_rad'\n"
SURVEY = "participant,group,comfort,naturalness,control,effort"
# The columns that each command needs, and how it is called.
COMMANDS = {
    "import": (("t", "x"), ["import", "t.csv", "out.mcap", "--mapping", "map.toml"]),
    "loading": (("theta_rad", "tau_Nm"), ["analyse", "loading", "t.csv"]),
    "smoothness": (("time_s", "theta_deg"), ["smoothness", "t.csv"]),
    "pendulum": (("time_s", "angle_deg"), ["assess", "pendulum", "t.csv"]),
    "interaction": (("time_s", "theta_deg"), ["analyse", "interaction", "."]),
}
COUNTED = ("empty cell", "not a number", "infinity")  # by import: not measured


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A command in an empty folder with a table; its output, or what it refused."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.toml").write_text(MAPPING)
    (tmp_path / "interaction.toml").write_text("simulated = true\nlast_s = 3\n" + MANIFEST)

    def call(words, content, mapping=None):
        content = content.encode() if isinstance(content, str) else content
        (tmp_path / "t.csv").write_bytes(content)
        if mapping is not None:
            (tmp_path / "map.toml").write_text(mapping)
        (tmp_path / "o.json").unlink(missing_ok=True)
        more = [] if "import" in words else ["--json", "o.json"]
        done = CliRunner().invoke(app, [*words, *more])
        if done.exception is None:
            return done.output
        assert isinstance(done.exception, UserError), done.exception
        assert {p.name for p in tmp_path.iterdir()} == {"t.csv", "map.toml", "interaction.toml"}
        raise done.exception

    return call


@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=[pytest.mark.ci] * (c != "import")) for c in COMMANDS]
)
@pytest.mark.parametrize("hostile", HOSTILE)
def test_every_command_refuses_it_alike(run, hostile, command):
    (first, second), words = COMMANDS[command]
    content, said = HOSTILE[hostile]
    content = content.encode() if isinstance(content, str) else content
    content = content.replace(b"AA", first.encode()).replace(b"BB", second.encode())
    if command == "import" and hostile in COUNTED:
        assert "t.csv: 4 rows" in (told := run(words, content))
        assert "missing values 1," in told
        return
    with pytest.raises(UserError) as caught:
        run(words, content)
    for part in ("t.csv", *said):
        assert part.replace("BB", second) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('p1,A,1,0,0,"1/2\np2,B,1,0,0,1\n', "line 2, character 12: a quote"),
        ("p1,A,1,0,0,1,9\n", "line 2 has 7 cells"),
        ("p1,A,1,0,0,much more\np2,B,1,0,1_0,1\n", "line 3, control: answer '1_0'"),
    ],
)
def test_a_survey_is_read_completely_or_refused(run, text, said):
    with pytest.raises(UserError, match=said):
        run(["analyse", "survey", "t.csv"], f"{SURVEY}\n{text}")


def test_import_counts_what_it_leaves_out_and_a_second_try_is_possible(run, tmp_path):
    words = COMMANDS["import"][1]
    rows = "".join(f"{k},{k / 2}\n" for k in range(4))
    with pytest.raises(UserError, match="there is no column 'x'"):
        run(words, "t,y\n" + rows)
    told = run(words, codecs.BOM_UTF8.decode() + "t,x\nnan,9\n" + rows + "inf,9\n,8\n4,\n")
    assert "left out: 3 rows with no 't' (lines 2, 7, 8)" in " ".join(told.split())
    log = esea_host.open_log(tmp_path / "out.mcap")
    np.testing.assert_array_equal(log["foreign"]["x_rad"], [0, 0.5, 1, 1.5, np.nan])
    np.testing.assert_allclose(log["foreign"].time_s, range(5))
    assert log.events("import")[0]["left_out"] == ["3 rows with no 't' (lines 2, 7, 8)"]
    with pytest.raises(UserError, match="already exists"):
        CliRunner().invoke(app, words, catch_exceptions=False, standalone_mode=False)
    (tmp_path / "out.mcap").unlink()
    # A quote as text, and a log with messages: the mapping's own words.
    quoting = '[format]\nquote = ""\n' + MAPPING
    assert "out.mcap: 2 rows" in run(words, 't,x,n\n0,1,"5 in\n1,2,ok\n', quoting)
    (tmp_path / "out.mcap").unlink()
    told = run(
        words, "boot\nt,x\n0,1\nreset\n1,oops\n2,3\n", "skip_lines = 1\nfields = 2\n" + MAPPING
    )
    assert "1 row of other than 2 cells (line 4); 1 row with no number" in " ".join(told.split())
    (tmp_path / "out.mcap").unlink()
    with pytest.raises(UserError, match=r"no row of numbers.*2 rows of other than 3 cells"):
        run(words, "t,x,n\n0,1\n1,2\n", "fields = 3\n" + MAPPING)
    with pytest.raises(UserError, match=r"line 3, column 'x': 'n/a'.*Or set fields"):
        run(words, "t,x\n0,1\n1,n/a\n", MAPPING)
    for scale, what in (
        (1e9, r"line 3, column 't': 1 is more than a year"),
        (1e-3, "0.001 s apart"),
    ):
        wrong = MAPPING.replace("period_s", f"scale = {scale}\nperiod_s")
        with pytest.raises(UserError, match=what):
            run(words, "t,x\n0,1\n1,2\n", wrong)


def reach(t):
    """Minimum jerk from 0 to 30 within 2 s from 1 s on."""
    u = np.clip((t - 1) / 2, 0, 1)
    return 30 * u**3 * (10 - 15 * u + 6 * u**2)


def measured(run, tmp_path, head, times, values, *more):
    rows = "".join(f"{t},{x:.9g}\n" for t, x in zip(times, values, strict=True))
    told = run(["smoothness", "t.csv", *more], f"{head}\n{rows}")
    found = json.loads((tmp_path / "o.json").read_text())
    return told, found, {(m["metric"], m["convention"]): m for m in found["metrics"]}


@pytest.mark.parametrize(
    ("rate", "head", "stamp", "unit"),
    [
        (75, "time [s],knee [deg]", lambda t: f"{t:.3f}", "deg/s^2"),
        (300, "t,theta_rad", lambda t: f"{t:.3f}", "rad/s^2"),
        (148, "time_ms,motor_angle", lambda t: f"{round(1e3 * t)}", "(motor_angle)/s^2"),
        (60, "Time (s),x_mm", lambda t: f"{t:.2f}", "mm/s^2"),
        (120, "timestamp_us,angle (\N{DEGREE SIGN})", lambda t: f"{round(1e6 * t)}", "deg/s^2"),
    ],
)
def test_smoothness_of_rounded_times_is_that_of_the_true_ones(
    run, tmp_path, rate, head, stamp, unit
):
    t = np.arange(4 * rate) / rate
    _, _, true = measured(run, tmp_path, "time_s,theta_deg", t, reach(t))
    told, _, mine = measured(run, tmp_path, head, [stamp(x) for x in t], reach(t))
    assert "column chosen:" in told
    assert mine["RMS acceleration", "thesis"]["unit"] == unit
    for key, metric in mine.items():
        assert metric["fs_Hz"] == rate
        assert metric["value"] == pytest.approx(true[key]["value"], rel=1e-6)
    # The speed of the same movement, integrated, gives the same accelerations.
    omega = np.gradient(reach(t), 1 / rate)
    more = ("--column", "omega_deg_s")
    _, _, of_speed = measured(run, tmp_path, "t,omega_deg_s", t, omega, *more)
    assert of_speed["RMS acceleration", "thesis"]["unit"] == "deg/s^2"
    assert of_speed["SPARC", "reference"]["value"] == pytest.approx(
        true["SPARC", "reference"]["value"], rel=0.01
    )


def test_smoothness_chooses_asks_and_resamples(run, tmp_path):
    rng = np.random.default_rng(1)
    t = np.arange(240) / 60
    late = t + rng.uniform(0, 0.3, 240) / 60
    with pytest.raises(UserError, match=r"o\.json is named twice: file and --json"):
        run(["smoothness", "./o.json"], "")
    with pytest.raises(UserError, match=r"interaction\.toml is read: folder and --report"):
        run(["analyse", "interaction", ".", "--report", "./interaction.toml"], "")
    with pytest.raises(UserError, match=r"--resample 60.* interpolates"):
        measured(run, tmp_path, "t,theta_deg", late, reach(late))
    more = ("--resample", "60")
    told, found, mine = measured(run, tmp_path, "t,theta_deg", late, reach(late), *more)
    assert found["resampled"]["frames"] == 240
    assert "resampled by" in told
    _, _, true = measured(run, tmp_path, "t,theta_deg", t, reach(t))
    for key in (("SPARC", "reference"), ("LDLJ", "reference")):
        assert mine[key]["value"] == pytest.approx(true[key]["value"], rel=0.01)
    keep = (t < 1.5) | (t > 1.7)
    with pytest.raises(UserError, match=r"A gap of 0.2.* less than 0.08"):
        measured(run, tmp_path, "t,theta_deg", t[keep], reach(t[keep]), *more)
    for head, said in (
        ("t,motor_rad,joint_rad", r"several columns may be .*'motor_rad', 'joint_rad'.*--column"),
        ("a,b,c", "no column of the time"),
        ("t,time_s,c", "several columns of the time"),
        ("t_Nm,x,y", "no column of the time"),
        ("t,motor_speed,tau_Nm", "no column may be .*'motor_speed', 'tau_Nm'.*--column"),
    ):
        rows = "".join(f"{x},{x},{x}\n" for x in t)
        with pytest.raises(UserError, match=said):
            run(["smoothness", "t.csv"], f"{head}\n{rows}")
    # It was taken for a position: the RMS acceleration of an acceleration, with exit code 0.
    for column in ("a_rad_s2", "v [deg/sec]", "tau_Nm", "speed"):
        with pytest.raises(UserError, match=f"movement: '{re.escape(column)}'"):
            measured(run, tmp_path, f"t,{column}", t, reach(t), "--column", column)
