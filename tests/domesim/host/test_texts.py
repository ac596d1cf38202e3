"""TOML is limited before it is parsed."""

from __future__ import annotations

import tomllib

import pytest

from domesim.host import texts
from domesim.host.texts import DEEPEST_TOML, LARGEST_TOML, toml_in

DEEP = ".".join("a" * (DEEPEST_TOML + 1))


@pytest.mark.parametrize(
    "text",
    [
        f"{DEEP} = 1",
        f"[{DEEP}]",
        f"[[ {DEEP.replace('.', ' . ')} ]]",
        f"x = 1\ny = {{{DEEP} = 1}}",
        '"a.b".' * DEEPEST_TOML + "c = 1",
        "a." * 100_000 + "a = 1",
        "x = " + "[" * 100_000,
        "x = " + "{a = " * 100_000,
    ],
)
def test_what_is_too_deep_is_not_parsed(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if text.count(".") > DEEPEST_TOML:
        monkeypatch.setattr(texts.tomllib, "loads", lambda text: pytest.fail("it was parsed"))
    with pytest.raises(tomllib.TOMLDecodeError, match=r"at most 8 parts|too deep"):
        toml_in(text)


def test_what_is_too_long_is_not_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(texts.tomllib, "loads", lambda text: pytest.fail("it was parsed"))
    with pytest.raises(tomllib.TOMLDecodeError, match="at most 1000000 characters"):
        toml_in("#" * (LARGEST_TOML + 1))


@pytest.mark.parametrize(
    "text",
    [
        f"{DEEP[2:]} = 1",
        "name = 'a sentence. With points. Many of them. " + "And more. " * 20 + "'",
        "x = [" + "1.5, " * 1000 + "]",
        "version = '1.2.3'",
    ],
)
def test_what_people_write_is_parsed(text: str) -> None:
    assert toml_in(text) == tomllib.loads(text)


def test_limits_are_looked_for_in_time_that_grows_with_the_text() -> None:
    """Words, quotes and points without an end: a search from each place would take hours."""
    for letters in ("a", '"', "'", '".', "a ", "-", '"a', "a\n", " . "):
        text = "# " + letters * (LARGEST_TOML // len(letters) - 10)
        texts._DEEPER.search(text)
