"""docs/measuring-by-meter.md: its commands say what stands there, of the tables that it shows."""

from __future__ import annotations

import datetime
import re
import shlex
import shutil
from pathlib import Path

import pytest
from command_line import exit_code
from told_numbers import assert_same_but_for_last_digits

FOLDER = Path(__file__).parents[1] / "docs"
PAGE = (FOLDER / "measuring-by-meter.md").read_text()
COMMANDS = re.findall(r"^```\n\$ (.*?)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("page")
    for table in (FOLDER / "measuring").glob("*.csv"):
        assert table.name in ("readings.csv", "pair.csv") or table.name in PAGE
        shutil.copy(table, path)
    first = (path / "dome-lux.csv").read_text().splitlines()[:3]
    (path / "two.csv").write_text("\n".join(first) + "\n")
    assert not exit_code("scene", "new", path / "mine.toml", "--radius", "7.5", "--quiet")
    assert "domesim scene new mine --radius 7.5" in PAGE
    return path


@pytest.mark.parametrize(
    ("command", "said"), COMMANDS, ids=[" ".join(each.split()[1:4]) for each, _ in COMMANDS]
)
def test_commands_say_what_the_page_says(folder, command, said, monkeypatch, run):
    monkeypatch.chdir(folder)
    arguments = ["64" if word == "4096" else word for word in shlex.split(command)]
    _, out, err = run(*arguments[1:])
    told = (out + err).replace("64 x 64", "4096 x 4096")
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    assert_same_but_for_last_digits(told.replace(today, "2026-11-28"), said)
