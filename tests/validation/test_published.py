"""Published figures: which are of today's code, and how those of a run take their place."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from domesim.errors import InputError
from validation import readme, results
from validation.experiment import Finding, at_most, load_experiment
from validation.experiments import EXPERIMENTS
from validation.origin import digest
from validation.readme import refuse_old
from validation.renew import Publisher
from validation.report import Outcome
from validation.results import Entry, Results, merged, old

FIRST, SECOND = EXPERIMENTS[:2]
DOME = '''
    """A dome."""
    def area(radius):
        """In m²."""
        from compensate import later
        return 6.28 * radius**2
    '''
FILES = {
    "validation/experiments/light.py": "from domesim.room import dome\nimport domesim.scenery",
    "domesim/room/dome.py": DOME,
    "domesim/scenery.py": 'from importlib.resources import files\nfolder = files("scenes")',
    "compensate/later.py": "import numpy",
    "compensate/other.py": "",
    "scenes/imax.toml": "albedo = 0.5",
}


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(dedent(text))
    return tmp_path


@pytest.mark.parametrize(
    ("file", "was", "now"),
    [
        ("domesim/room/dome.py", "6.28", "6.283"),
        ("domesim/room/dome.py", "radius**2", "(radius + 1)**2"),
        ("compensate/later.py", "numpy", "scipy"),
        ("scenes/imax.toml", "0.5", "0.6"),
    ],
)
def test_a_digest_changes_with_what_the_code_does(packages, file, was, now):
    before = digest("light", packages)
    text = (packages / file).read_text()
    (packages / file).write_text(text.replace(was, now, 1))
    assert digest("light", packages) != before


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("domesim/room/dome.py", DOME.replace("In m²", "The area, m²").replace("A dome", "Domes")),
        ("domesim/room/dome.py", DOME.replace("6.28 *", "(6.28)  *").replace("2\n", "2  # m²\n")),
        ("compensate/other.py", "import numpy"),
        ("scenes/__init__.py", "import numpy"),
    ],
)
def test_a_digest_does_not_change_with_anything_else(packages, file, text):
    before = digest("light", packages)
    (packages / file).write_text(dedent(text))
    assert digest("light", packages) == before


def test_what_runs_a_command_rests_on_all_commands(packages):
    path = packages / "validation/experiments/light.py"
    path.write_text('import subprocess\nsubprocess.run(["python", "-m", "domesim"])')
    before = digest("light", packages)
    (packages / "compensate/other.py").write_text("import numpy")
    assert digest("light", packages) != before


def entry(**changes: object) -> Entry:
    known = {"status": "as expected", "date": "2030-01-01", "machine": "M", "code": "c"}
    return Entry.model_validate({**known, "seconds": 1.0, "figures": {"f": 1.0}, **changes})


def test_the_newer_figures_are_published():
    kept = Results(experiments={"gone": entry(), FIRST: entry(), SECOND: entry()})
    newer = entry(date="2030-01-02", figures={"f": 2.0, "unquoted": 3.0})
    assert merged(kept, Results(experiments={SECOND: newer}), {"f"}).experiments == {
        FIRST: entry(),
        SECOND: entry(date="2030-01-02", figures={"f": 2.0}),
    }
    for worse in (
        entry(date="2029-12-31"),
        entry(date="2030-01-02", status="broken"),
        entry(date="2030-01-02", figures={"unquoted": 3.0}),
    ):
        left = merged(kept, Results(experiments={FIRST: worse}), {"f"})
        assert left.experiments[FIRST] == entry()
    for run in (Results(quick=True), Results(seed=1)):
        with pytest.raises(InputError, match="a full run of seed 0"):
            merged(kept, run, set())


def test_old_figures_are_named_and_refused(monkeypatch):
    monkeypatch.setattr(results, "digest", {FIRST: "c", SECOND: "d"}.get)
    monkeypatch.setattr(results, "EXPERIMENTS", (FIRST, SECOND))
    found = Results(experiments={FIRST: entry(), SECOND: entry()})
    assert old(found) == [SECOND]
    assert old(Results(experiments={SECOND: entry(code="d")})) == [FIRST]
    with pytest.raises(InputError, match=f"make full ONLY={SECOND}$"):
        refuse_old(found)
    refuse_old(Results(experiments={FIRST: entry(), SECOND: entry(figures={})}))


class Silent:
    def __init__(self) -> None:
        self.ended: list[str] = []

    def starts(self, name: str) -> None: ...
    def note(self, text: str) -> None: ...
    def ends(self, outcome: Outcome) -> None:
        self.ended.append(outcome.name)


def test_a_run_publishes_each_experiment_when_it_ends(tmp_path, monkeypatch):
    monkeypatch.setattr("validation.renew.quoted", lambda: {"f"})
    path = tmp_path / "results.json"
    Results(experiments={SECOND: entry()}).write(path)
    listener = Silent()
    publisher = Publisher(listener, path)
    finding = Finding(result="", checks=(at_most("x", 1, 2),))
    for name, status in ((FIRST, "as expected"), (SECOND, "not run")):
        now = entry(date="2031-01-01", status=status)
        publisher.ends(Outcome(load_experiment(name), now, finding=finding))
    assert Results.read(path).experiments == {FIRST: entry(date="2031-01-01"), SECOND: entry()}
    assert listener.ended == [FIRST, SECOND]


def test_results_of_another_machine_are_taken_over(tmp_path, monkeypatch):
    """And pages are left as they are where others are older than their code."""
    monkeypatch.setattr(readme, "PUBLISHED", tmp_path / "results.json")
    monkeypatch.setattr(readme, "ROOT", tmp_path)
    monkeypatch.setattr(readme, "PAGES", ("limits.md",))
    monkeypatch.setattr(readme, "TEMPLATES", tmp_path)
    (tmp_path / "limits.md.j2").write_text(
        '{{ "f" | figure("{:.0f}") }} and {{ "g" | figure("{:.0f}") }}'
    )
    monkeypatch.setattr(results, "digest", lambda name: "d")
    Results(experiments={FIRST: entry(), SECOND: entry(figures={"g": 5.0})}).write(
        tmp_path / "results.json"
    )
    for number, name in enumerate((FIRST, SECOND)):
        one = entry(date="2031-01-01", code="d", figures={"fg"[number]: 7.0})
        Results(experiments={name: one}).write(tmp_path / f"{name}.json")
    with pytest.raises(InputError, match=f"older ones of {SECOND};"):
        readme.main(tmp_path / f"{FIRST}.json")
    assert not (tmp_path / "limits.md").exists()
    readme.main(tmp_path / f"{SECOND}.json")
    assert (tmp_path / "limits.md").read_text() == "7 and 7"
