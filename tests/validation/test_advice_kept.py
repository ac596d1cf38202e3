"""The experiment on advice: it sees whether advice was followed, and comes true."""

from __future__ import annotations

import pytest

from validation.experiment import Work
from validation.experiments import advice


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(advice, "THEATRES", ("dome_hemisphere",))
    monkeypatch.setattr(advice, "SHOWS", ("ten stars",))
    monkeypatch.setattr(advice, "SIZE", 96)


@pytest.mark.usefixtures("small")
def test_advice_comes_true_in_a_bare_dome() -> None:
    found = advice.run(Work(quick=True))
    assert not found.failed
    assert found.figures["advice.off"] < 0.01
    ((*_, today, paint, advised, promised, traced, white),) = found.tables[0].rows
    assert promised <= (1 - advice.SAVED) * today + 1e-6
    assert traced == pytest.approx(promised, abs=0.01)
    assert white == pytest.approx(100 * advised / paint)


@pytest.mark.usefixtures("small")
def test_paint_that_was_not_changed_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    followed = advice.followed

    def ignored(content: dict[str, object], *arguments: object) -> object:
        screen = {**content["screen"], "albedo": 0.5}  # type: ignore[dict-item]
        return followed({**content, "screen": screen}, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(advice, "followed", ignored)
    assert advice.run(Work(quick=True)).failed
