from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest

import benchmark.localizers.registry
from benchmark import cli
from benchmark.commands.progress import Pace, duration
from benchmark.config import EpisodeConfig, preset
from benchmark.doctor import check_gl, examine
from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, PieceRecord, PoseErrors
from benchmark.records.store import EPISODES_FILE

SMALL = ("--scenes", "1", "--parts", "hub", "--workers", "1")


def fake_episode(config: EpisodeConfig) -> EpisodeRecord:
    result = LocalizerResult(True, True, PoseErrors(0.5, 0.4, None, 0.4, 1.0))
    results = {"focal-region": result, "focal-group": result, "focal": result}
    pieces = tuple(PieceRecord(i, config.parts[0], 0.9, True, results) for i in range(config.pieces))
    timings = {"drop": 0.5, "render": 0.25, "total": 2.0}
    return EpisodeRecord(
        config.key, config.parts, config.scene, config.seed, config.config_hash, pieces=pieces, timings_s=timings
    )


@pytest.fixture
def simulator(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """Stands in for the real episode, which takes seconds."""
    module = types.ModuleType("benchmark.episodes.episode")
    module.run_episode = fake_episode
    monkeypatch.setitem(sys.modules, "benchmark.episodes.episode", module)
    monkeypatch.setattr("benchmark.world.gl.works", lambda *_, **__: True)
    return module


def fails_with_one_line(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 2) -> str:
    capsys.readouterr()
    assert cli.main(arguments) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("focalpick: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_sweep_then_table_then_check(
    tmp_path: Path, simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert cli.main(["sweep", *SMALL, "--out", str(out)]) == 0
    err = capsys.readouterr().err
    assert "Mean wall time per episode" in err
    assert f"focalpick table {out}" in err.replace("\n", " ")
    assert cli.main(["table", str(out), "--format", "json", "--figures", str(tmp_path / "figures")]) == 0
    table = json.loads(capsys.readouterr().out)
    assert [row["n"] for row in table["table1"]] == [0, 0, 4]
    assert (tmp_path / "figures" / "fig10.png").exists()
    for style in ("text", "md"):
        assert cli.main(["table", str(out), "--format", style]) == 0
        assert "0.50 ± 0.00" in capsys.readouterr().out
    thresholds = tmp_path / "thresholds.toml"
    for limit, code, word in ((0.6, 0, "ok"), (0.4, 1, "MISSED")):
        thresholds.write_text(f"[focal.hub]\ntranslation_mm_mean = {limit}")
        assert cli.main(["check", str(out), "--thresholds", str(thresholds)]) == code
        assert f"{word:6}  focal.hub.translation_mm_mean: 0.5 (n = 4)" in capsys.readouterr().out


def test_run_prints_each_piece(simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["run", "--part", "hub", "--seed", "7", "--pieces", "5"]) == 0
    out = capsys.readouterr().out
    assert out.count("0.50 mm, tilt 0.40°") == 15
    assert "drop 0.50 s" in out


def test_run_is_an_episode_of_the_paper_where_nothing_else_is_said(
    simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    seed = preset("table1").seed
    for scene, pieces in ((s, preset("table1").episode("hub", s).pieces) for s in range(3)):
        assert cli.main(["run", "--part", "hub", "--seed", str(seed), "--scene", str(scene)]) == 0
        assert capsys.readouterr().out.count("0.50 mm, tilt 0.40°") == 3 * pieces


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sweep", "--pieces", "6-4"], "pieces: got 6-4; expected a number from 1 to 12, or two of them such as 4-6"),
        (["run", "--pieces", "many"], "pieces: got many; expected a number from 1 to 12"),
        (["sweep", "--parts", "hat"], "got hat; expected one of hub, cover1, cover2"),
        (["sweep", "--parts", "hub,,cover1"], "got nothing"),
        (["sweep", "--sensor", "moon"], "expected ideal or lab or shopfloor"),
        (["sweep", "--preset", "table2"], "expected table1 or smoke"),
        (["sweep", "--scenes", "0"], "from 1 to 100000"),
        (["sweep", "--scenes", "many"], "--scenes"),
        (["sweep", "--scenery", "3"], "--scenery"),
        (["run", "--part", "hat"], "got hat; expected one of hub"),
        (["table", "nowhere"], "nowhere/sweep.json"),
        (["table"], "DIR"),
        (["check", "nowhere", "--thresholds", "nothing.toml"], "nothing.toml"),
        (["view", "nowhere"], "focalpick run --rrd FILE"),
        (["tabel"], "expected one of doctor"),
        (["assets", "destroy"], "expected one of assets build, assets teach"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in fails_with_one_line(capsys, *arguments)


@pytest.mark.parametrize("localizer", ["best", "nowhere:best"])
def test_unknown_localizer(
    tmp_path: Path, localizer: str, simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in (["sweep", *SMALL, "--out", str(tmp_path / "out")], ["run"]):
        assert "localizer" in fails_with_one_line(capsys, *command, "--localizer", localizer)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("content", "message"), [(None, "hub.json"), ("{", "hub.json")])
def test_missing_or_corrupt_vision_model(
    tmp_path: Path,
    content: str | None,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("benchmark.world.gl.works", lambda *_, **__: True)
    monkeypatch.setattr("benchmark.models.MODELS", tmp_path)
    benchmark.models.load_model.cache_clear()
    if content is not None:
        (tmp_path / "hub.json").write_text(content)
    assert message in fails_with_one_line(capsys, "sweep", *SMALL, "--out", str(tmp_path / "out"))
    benchmark.models.load_model.cache_clear()


def test_unwritable_output(tmp_path: Path, simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert "writable" in fails_with_one_line(capsys, "sweep", *SMALL, "--out", str(tmp_path / "file" / "out"))
    assert "--rrd" in fails_with_one_line(capsys, "run", "--rrd", str(tmp_path / "file" / "a.rrd"))


def test_corrupt_records(tmp_path: Path, simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(["sweep", *SMALL, "--out", str(tmp_path)])
    (tmp_path / EPISODES_FILE).write_text("not json\n")
    assert f"{EPISODES_FILE} line 1" in fails_with_one_line(capsys, "table", str(tmp_path))
    assert f"{EPISODES_FILE} line 1" in fails_with_one_line(capsys, "sweep", *SMALL, "--out", str(tmp_path))


def test_wrong_thresholds_key(
    tmp_path: Path, simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    cli.main(["sweep", *SMALL, "--out", str(tmp_path)])
    thresholds = tmp_path / "thresholds.toml"
    thresholds.write_text("[focal.hub]\nmatching = 1")
    message = fails_with_one_line(capsys, "check", str(tmp_path), "--thresholds", str(thresholds))
    assert "matching_rate_low" in message


def test_missing_gl(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("benchmark.world.gl.works", lambda *_, **__: False)
    for asked in ("osmesa", ""):
        monkeypatch.setenv("MUJOCO_GL", asked)
        assert "apt-get install" in fails_with_one_line(capsys, "run")


@pytest.mark.parametrize(
    "command",
    [
        ["run"],
        ["sweep", "--scenes", "1", "--out", "{}"],
        ["teach", "--part", "hub", "--dir", "{}"],
        ["assets", "teach", "--out", "{}"],
    ],
    ids=lambda command: command[0],
)
def test_an_unknown_backend_is_one_line_before_anything_runs(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    out = tmp_path / "out"
    message = fails_with_one_line(capsys, *(word.format(out) for word in command))
    assert "MUJOCO_GL: got vulkan; expected glfw, egl, osmesa" in message
    assert not out.exists()


def test_a_bug_is_one_line_with_the_path_of_its_traceback(
    tmp_path: Path, simulator: types.ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(config: EpisodeConfig) -> EpisodeRecord:
        raise ZeroDivisionError("over there")

    simulator.run_episode = broken
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    message = fails_with_one_line(capsys, "run", code=70)
    (saved,) = tmp_path.glob("focalpick-*.txt")
    assert str(saved) in message
    assert "in broken" in saved.read_text()


def test_interrupt(simulator: types.ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(config: EpisodeConfig) -> EpisodeRecord:
        raise KeyboardInterrupt

    simulator.run_episode = interrupted
    assert "stopped" in fails_with_one_line(capsys, "run", code=130)


SLOW_SWEEP = """
import sys, time, types
sys.path.insert(0, {tests!r})

def slow_episode(config):
    import time
    from test_cli import fake_episode
    time.sleep(0.3)
    return fake_episode(config)

if __name__ == "__main__":
    module = types.ModuleType("benchmark.episodes.episode")
    module.run_episode = slow_episode
    sys.modules["benchmark.episodes.episode"] = module
    from benchmark.cli import main
    sys.exit(main(["sweep", "--scenes", "200", "--parts", "hub", "--workers", sys.argv[2], "--out", sys.argv[1]]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_stops_a_sweep_cleanly_and_says_how_to_go_on(tmp_path: Path, workers: int) -> None:
    script, out = tmp_path / "script.py", tmp_path / "out"
    script.write_text(SLOW_SWEEP.format(tests=str(Path(__file__).parent)))
    command = [sys.executable, str(script), str(out), str(workers)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        deadline = time.monotonic() + 60
        while not (out / EPISODES_FILE).exists() or (out / EPISODES_FILE).read_bytes().count(b"\n") < 2:
            assert time.monotonic() < deadline, "the sweep did not get going"
            assert process.poll() is None
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
        _, err = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            process.kill()
    assert process.returncode == 130
    lines = err.strip().splitlines()
    assert lines[-1].startswith("focalpick: stopped; ")
    assert "The same command goes on" in lines[-1]
    assert "Traceback" not in err


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_help_has_an_example_and_explains_every_option(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main([*name.split(), "--help"])
    assert end.value.code == 0
    out = capsys.readouterr().out
    assert "Example: focalpick" in out
    assert "{None}" not in out


def test_overview_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in ([], ["--help"]):
        assert cli.main(arguments) == 0
        out = capsys.readouterr().out
        assert all(f"  {name} " in out for name in cli.COMMANDS)


def test_help_works_where_the_simulator_cannot_be_loaded() -> None:
    code = (
        "import sys\n"
        "for name in ('mujoco', 'dm_control', 'rerun'): sys.modules[name] = None\n"
        "from benchmark.cli import main\n"
        "sys.exit(main(['--help']))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def test_output_into_a_closed_pipe_is_no_error(tmp_path: Path, simulator: types.ModuleType) -> None:
    cli.main(["sweep", *SMALL, "--out", str(tmp_path)])
    command = f"{sys.executable} -m benchmark.cli table {tmp_path} --format json | head -c 1"
    done = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_doctor_finds_what_is_wrong(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("benchmark.world.gl.works", lambda *_, **__: False)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    assert cli.main(["doctor"]) == 1
    assert "problem  OpenGL" in capsys.readouterr().out


def test_doctor_reports_an_unknown_backend(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("benchmark.doctor.CHECKS", {"OpenGL": check_gl})
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    assert cli.main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "problem  OpenGL: MUJOCO_GL: got vulkan; expected glfw, egl, osmesa; unset it" in out
    assert "everything is there" not in out


def test_doctor_reports_a_check_that_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise RuntimeError("no idea")

    monkeypatch.setattr("benchmark.doctor.CHECKS", {"thing": broken})
    (finding,) = examine()
    assert (finding.ok, finding.text) == (False, "RuntimeError: no idea")


def test_view_opens_all_recordings_of_a_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commands = []

    class Viewer:
        def __init__(self, command: list[str], **_: object) -> None:
            commands.append(command)

        def wait(self) -> int:
            return 0

        def poll(self) -> int:
            return 0

    monkeypatch.setattr("subprocess.Popen", Viewer)
    (tmp_path / "b.rrd").touch()
    (tmp_path / "a.rrd").touch()
    assert cli.main(["view", str(tmp_path), "--web"]) == 0
    assert commands[0][-3:] == ["--web-viewer", str(tmp_path / "a.rrd"), str(tmp_path / "b.rrd")]


def test_view_without_a_display_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    (tmp_path / "a.rrd").touch()
    assert "--web" in fails_with_one_line(capsys, "view", str(tmp_path / "a.rrd"))


def test_pace_leaves_the_first_episode_of_each_worker_out() -> None:
    pace = Pace(workers=2, now=0.0)
    assert pace.remaining_s(10) is None
    for now in (30.0, 31.0):
        pace.finish(now)
    assert pace.remaining_s(10) == pytest.approx(155)  # nothing better is known yet
    for now in (33.0, 34.0, 37.0):
        pace.finish(now)
    assert pace.remaining_s(10) == pytest.approx(20)


@pytest.mark.parametrize(
    ("seconds", "text"), [(4.4, "4 s"), (89, "89 s"), (150, "2 min"), (3600 * 2.1, "2 h 06 min")]
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_ctrl_c_ends_the_program_even_where_an_import_swallows_it(tmp_path):
    (tmp_path / "swallowing.py").write_text(
        "import time\n"
        "try:\n"
        "    print('importing', flush=True)\n"
        "    time.sleep(30)\n"
        "except KeyboardInterrupt:\n"
        "    pass\n"
        "def command():\n"
        "    print('ran')\n"
    )
    program = "import sys; from benchmark import cli; cli.COMMANDS['x'] = 'swallowing:command'; sys.exit(cli.main())"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    with subprocess.Popen(
        [sys.executable, "-c", program, "x"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "importing\n"
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=20)
    assert (process.returncode, rest, errors) == (130, "", "focalpick: stopped\n")


@pytest.mark.parametrize("encoding", ["ascii", "iso8859-15", "cp1252"])
def test_a_terminal_without_a_character_shows_a_question_mark(encoding):
    text = "0.5\N{DEGREE SIGN} \N{BOX DRAWINGS LIGHT HORIZONTAL} \N{GREEK SMALL LETTER MU}m"
    code = f"from benchmark import cli; cli._let_every_terminal_show_the_output(); print({text!a})"
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True)
    assert b"0.5" in done.stdout
    assert b"?" in done.stdout


@pytest.mark.slow
def test_impatient_ctrl_c_prints_no_traceback(tmp_path: Path) -> None:
    script, out = tmp_path / "script.py", tmp_path / "out"
    patient = 'main(["sweep", "--scenes", "200", "--parts", "hub", "--workers", sys.argv[2], "--out", sys.argv[1]])'
    assert patient in SLOW_SWEEP
    source = SLOW_SWEEP.replace(patient, "main()").format(tests=str(Path(__file__).parent))
    script.write_text(source)
    options = ["sweep", "--scenes", "200", "--parts", "hub", "--workers", "1", "--out", str(out)]
    process = subprocess.Popen([sys.executable, str(script), *options], stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 60
        while not (out / EPISODES_FILE).exists() or not (out / EPISODES_FILE).read_bytes():
            assert time.monotonic() < deadline, "the sweep did not get going"
            time.sleep(0.05)
        for _ in range(3):
            process.send_signal(signal.SIGINT)
            time.sleep(0.02)
        _, err = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            process.kill()
    assert process.returncode == 130
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("explain", "picture.png", "--out", ""),
        ("table", "results/table1", "--figures="),
        ("teach", "--dir", ""),
        ("run", ""),
    ],
)
def test_an_empty_text_is_no_path(arguments, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert "got an empty text; expected a name" in fails_with_one_line(capsys, *arguments)
    assert not list(tmp_path.iterdir())
