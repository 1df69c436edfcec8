"""The program `lightpath` of the package."""

import json
import os
import signal
import subprocess
import sys
import sysconfig

import pytest

import lightpath
from shapes import TRIANGLE

FOLDER = os.path.dirname(os.path.dirname(lightpath.__file__))


def run(*command, folder=None):
    environment = {**os.environ, "PYTHONPATH": FOLDER}
    command = [sys.executable, *command]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)


def program(*arguments, folder=None):
    return run("-m", "lightpath", *arguments, folder=folder)


def test_help_and_errors_are_those_of_the_program():
    assert lightpath.__version__ in program("--version").stdout
    for arguments in (["--help"], ["render", "--help"]):
        done = program(*arguments)
        assert done.returncode == 0 and "Usage: lightpath" in done.stdout and "Exit codes" in done.stdout
        assert done.stderr == ""
    missing = program("render", "nothing.json")
    assert missing.returncode == 2 and "nothing.json" in missing.stderr
    unknown = program("rendre")
    assert unknown.returncode == 2 and "unrecognized subcommand 'rendre'" in unknown.stderr
    unknown = program("render", "a.json", "--sppp", "4")
    assert unknown.returncode == 2 and "unexpected argument '--sppp'" in unknown.stderr


def test_names_need_not_be_utf8():
    done = program("render", b"n\xffthing.json")
    assert done.returncode == 2 and "thing.json" in done.stderr and "Traceback" not in done.stderr


def test_a_bench_records_its_command(tmp_path):
    (tmp_path / "one.ply").write_text(TRIANGLE)
    words = ["bench", "one.ply", "--quick", "--backends", "bvh", "--save-baseline", "b.json"]
    done = program(*words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "b.json").read_text())["run"]["command"] == words


def test_tasks_run_the_program_not_the_interpreter(tmp_path):
    (tmp_path / "one.ply").write_text(TRIANGLE)
    (tmp_path / "job.json").write_text('{ "inputs": ["one.ply"] }')
    words = ["submit", "slurm", "job.json", "-o", "out", "--dry-run"]
    script = tmp_path / "lightpath"
    script.write_text("from lightpath.__main__ import main\nmain()\n")
    done = run("lightpath", *words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f" {script} {tmp_path / 'job.json'} " in done.stdout
    done = program(*words, folder=tmp_path)
    installed = os.path.join(sysconfig.get_path("scripts"), "lightpath")
    if os.path.exists(installed):
        assert f" {installed} " in done.stdout
    else:
        assert done.returncode == 2 and f"{installed}: found no such file" in done.stderr


@pytest.mark.parametrize("before, within", [
    (signal.SIG_IGN, signal.SIG_IGN), (signal.default_int_handler, signal.SIG_DFL),
])
def test_an_ignored_interrupt_stays_ignored(monkeypatch, before, within):
    from lightpath import __main__ as main

    monkeypatch.setattr(main, "_main", lambda words, program: signal.getsignal(signal.SIGINT))
    old = signal.signal(signal.SIGINT, before)
    try:
        with pytest.raises(SystemExit) as end:
            main.main()
    finally:
        signal.signal(signal.SIGINT, old)
    assert end.value.code == within
