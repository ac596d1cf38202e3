"""The report of experiments: what is kept, what is red, and what it looks like."""

from __future__ import annotations

import json
import pkgutil
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
import typer

from domesim.errors import InputError
from validation import experiments, report
from validation.cli import validate as command
from validation.drawing import plot
from validation.experiment import (
    Check,
    Column,
    Experiment,
    Finding,
    Missing,
    Panel,
    Pictures,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    between,
    equal,
    load_experiment,
)
from validation.origin import digest
from validation.results import Results

PIXEL = "data:image/gif;base64,R0lGODlhAQABAIAAAP///wAAACH5BAAAAAAALAAAAAABAAEAAAICRAEAOw=="


@cache
def line() -> Plot:
    """Drawn once, for that takes longer than all else."""
    return plot("A line.", "A line that rises.", lambda axes: axes.plot([1, 2]))


@dataclass
class Stub:
    """Stands in for an experiment's module."""

    found: float = 1.0
    raises: BaseException | None = None
    runs: int = 0
    judged: bool = True

    def run(self, work: Work) -> Finding:
        def measure() -> float:
            self.runs += 1
            if self.raises is not None:
                raise self.raises
            return self.found

        value = work.step("a figure", float, measure)
        return Finding(
            result=f"It is {value}.\n\nA <second> paragraph.",
            checks=(at_most("the figure", value, 2, "cd/m²"),),
            advice="Do this.",
            tables=(
                Table(
                    caption="Figures.",
                    columns=(Column(name="what"), Column(name="much", unit="m", digits=".2f")),
                    rows=(("a" * 30, value), ("b", None)),
                ),
            ),
            plots=(line(),),
            pictures=(Pictures(caption="Dots.", panels=(Panel(title="A", alt="A", data=PIXEL),)),),
            figures={"stub.figure": value},
            left_out=("The rest.",),
            judged=self.judged,
        )


class Silent:
    def starts(self, name: str) -> None: ...
    def note(self, text: str) -> None: ...
    def ends(self, outcome: report.Outcome) -> None: ...


@pytest.fixture
def stubs(monkeypatch: pytest.MonkeyPatch) -> dict[str, Stub]:
    """The first experiments are stubs."""
    found = {name: Stub() for name in experiments.EXPERIMENTS}

    def load(name: str) -> Experiment:
        return Experiment(name, f"Claim of {name}.", "Because.", "This.", found[name])

    monkeypatch.setattr(report, "load_experiment", load)
    return found


NAMES = experiments.EXPERIMENTS[:3]


def run(folder: Path, **settings) -> report.Run:
    folder.mkdir(exist_ok=True)
    return report.validate(folder, Silent(), **{"names": NAMES, **settings})


def test_what_was_not_judged_is_not_as_expected(stubs, tmp_path):
    """Nor is it a failure; what is not as expected is that, judged or not."""
    for stub in stubs.values():
        stub.judged = False
    stubs[NAMES[1]].found = 3.0
    done = run(tmp_path)
    assert [one.status for one in done.outcomes] == ["not judged", "not as expected", "not judged"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<strong>Not judged:</strong>" in page
    stubs[NAMES[1]].found = 1.0
    done = run(tmp_path, fresh=True)
    assert done.passed
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Nothing could be judged here" in page
    assert "met the limits" not in page


def test_figures_are_written_for_a_paper(stubs, tmp_path):
    stubs[NAMES[2]].raises = Missing("needs a moon")
    done = run(tmp_path / "run")
    names = {path.name for path in report.write_figures(done, tmp_path / "figures")}
    first = NAMES[0]
    assert names == {path.name for path in (tmp_path / "figures").iterdir() if path.suffix}
    assert len(names) == 8
    assert (tmp_path / "figures" / f"{first}-plot-1.pdf").read_bytes().startswith(b"%PDF")
    assert "<svg" in (tmp_path / "figures" / f"{first}-plot-1.svg").read_text()
    read = (tmp_path / "figures" / f"{first}-plot-1.csv").read_text()
    assert read == "series,x,y\n1,0,1\n1,1,2\n"
    assert (tmp_path / "figures" / f"{first}-table-1.csv").read_text() == (
        f'what,"much, m"\n{"a" * 30},1.0\nb,\n'
    )


def test_every_module_is_listed_and_says_what_it_claims():
    modules = {module.name for module in pkgutil.iter_modules(experiments.__path__)}
    assert modules == set(experiments.EXPERIMENTS)
    for name in modules:
        experiment = load_experiment(name)
        assert experiment.claim.endswith(".")
        assert len(experiment.claim) < 120
        assert len(experiment.rationale) > 40
        assert len(experiment.expected) > 40


@pytest.mark.parametrize(
    ("check", "passes", "words"),
    [
        (at_most("x", 2.0, 2.0), True, "at most 2"),
        (at_most("x", 2.1, 2.0), False, "at most 2"),
        (at_least("x", 2.0, 2.0), True, "at least 2"),
        (at_least("x", 1.9, 2.0), False, "at least 2"),
        (between("x", 0.5, 0, 1), True, "0 to 1"),
        (between("x", -0.1, 0, 1), False, "0 to 1"),
        (between("x", float("nan"), 0, 1), False, "0 to 1"),
        (equal("x", 3, 3, "m"), True, "3 m"),
        (equal("x", 4, 3), False, "3"),
    ],
)
def test_checks(check, passes, words):
    assert check.passed is passes
    assert check.expected == words


def test_a_table_wants_full_rows():
    with pytest.raises(ValueError, match="2 columns"):
        Table(caption="c", columns=(Column(name="a"), Column(name="b")), rows=((1.0,),))


def test_results_are_figures_with_their_origin(tmp_path, stubs):
    stubs[NAMES[1]].found = float("inf")
    stubs[NAMES[2]].raises = Missing("needs a telescope")
    done = run(tmp_path, seed=3)
    found = Results.read(tmp_path / "results.json")
    assert found == done.results
    assert (found.quick, found.seed) == (False, 3)
    first, second, third = (found.experiments[name] for name in NAMES)
    assert first.figures == {"stub.figure": 1.0}
    assert first.code == digest(NAMES[0])
    assert first.machine.endswith(" cores")
    assert second.figures == {"stub.figure": None}
    assert (third.status, third.figures) == ("not run", {})
    (tmp_path / "results.json").write_text("{}x")
    with pytest.raises(InputError, match="wanted results of domesim validate"):
        Results.read(tmp_path / "results.json")


def test_outcomes(tmp_path, stubs):
    stubs[NAMES[1]].found = 3.0
    stubs[NAMES[2]].raises = Missing("needs a telescope")
    results = run(tmp_path)
    assert [one.status for one in results.outcomes] == [
        "as expected",
        "not as expected",
        "not run",
    ]
    assert not results.passed
    assert results.results.figures == {"stub.figure": 3.0}
    assert results.outcomes[1].entry.failed == ("the figure: 3 cd/m², expected at most 2 cd/m²",)
    stubs[NAMES[1]].found = 1.0
    assert run(tmp_path, fresh=True).passed
    stubs[NAMES[0]].raises = ZeroDivisionError("by nothing")
    results = run(tmp_path, fresh=True)
    assert results.outcomes[0].status == "broken"
    assert "by nothing" in results.outcomes[0].note
    assert results.outcomes[1].status == "as expected"
    assert not results.passed


def test_a_killed_run_goes_on(tmp_path, stubs):
    stubs[NAMES[1]].raises = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "1 of 1 experiment met" in page
    assert "still to come: 2." in page
    stubs[NAMES[1]].raises = None
    assert len(run(tmp_path).outcomes) == 3
    assert [stubs[name].runs for name in NAMES] == [1, 2, 1]


def test_what_was_measured_otherwise_is_measured_again(tmp_path, stubs, monkeypatch):
    first = stubs[NAMES[0]]
    run(tmp_path)
    run(tmp_path)
    assert first.runs == 1
    run(tmp_path, seed=1)
    assert first.runs == 2
    run(tmp_path, quick=True)
    assert first.runs == 3
    run(tmp_path)
    assert first.runs == 3  # the full run's are still there
    run(tmp_path, fresh=True, names=NAMES[:1])
    assert first.runs == 4
    assert stubs[NAMES[1]].runs == 3
    (file,) = (tmp_path / report.STEPS / NAMES[0]).glob("*full-0/*.json")
    file.write_text(file.read_text()[:-5])
    run(tmp_path)
    assert first.runs == 5
    monkeypatch.setattr(report, "digest", {NAMES[0]: "f" * 64}.get)
    run(tmp_path, names=NAMES[:1])
    assert first.runs == 6
    assert len(list((tmp_path / report.STEPS / NAMES[0]).iterdir())) == 1
    assert len(list((tmp_path / report.STEPS / NAMES[1]).iterdir())) == 3


def test_a_program_that_changes_is_noticed(tmp_path, stubs, monkeypatch):
    digests = iter("abcd")
    monkeypatch.setattr(report, "digest", lambda name: 64 * next(digests))
    with pytest.raises(InputError, match="was changed while it ran"):
        run(tmp_path)


def test_nothing_that_ran_is_not_green(tmp_path, stubs):
    for name in NAMES:
        stubs[name].raises = Missing("needs a telescope")
    run(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "Nothing could be run here" in page
    assert 'class="verdict good"' not in page


def test_there_is_something_to_fail():
    with pytest.raises(ValueError, match="needs a bound"):
        Check(what="x", found=1.0)
    with pytest.raises(ValueError, match="needs a bound"):
        at_most("x", 1.0, float("nan"))
    with pytest.raises(ValueError, match="checks"):
        Finding(result="Fine.", checks=())


def test_infinite_figures_are_kept(tmp_path):
    for _ in range(2):
        work = Work(store=tmp_path)
        assert work.step("far", tuple[float, float], lambda: (float("inf"), 1.0))[0] > 1e300
    (tmp_path / next(tmp_path.glob("*.json")).name).read_text().index("Infinity")
    assert Work(store=tmp_path).step("far", tuple[float, float], lambda: (0.0, 0.0))[0] > 1e300


def test_two_steps_of_one_name_are_a_mistake():
    work = Work()
    work.step("a", float, lambda: 1.0)
    with pytest.raises(ValueError, match="two steps are called 'a'"):
        work.step("a", float, lambda: 2.0)


def test_steps_have_files_of_their_own(tmp_path):
    work = Work(store=tmp_path)
    for value, name in enumerate(("a b", "a-b", "a/b", "../a b", "ä" * 300)):
        assert work.step(name, float, lambda value=value: float(value)) == value
    again = Work(store=tmp_path)
    assert again.step("a/b", float, lambda: -1.0) == 2
    assert len(list(tmp_path.glob("*.json"))) == 5


def test_an_unknown_experiment_is_refused(tmp_path):
    with pytest.raises(InputError, match="no experiment is called telepathy; there are closed_f"):
        run(tmp_path, names=("telepathy",))


def test_the_command_exits_with_1_if_anything_is_not_as_expected(tmp_path, stubs, capsys):
    settings = {"quick": True, "seed": 0, "fresh": True, "quiet": False, "json": False}
    command(out=tmp_path, only=",".join(NAMES), **settings)
    assert "nothing other than expected" in capsys.readouterr().out
    stubs[NAMES[1]].found = 3.0
    stubs[NAMES[2]].raises = Missing("needs ColorVideoVDP: pip install 'domesim[metrics]'")
    with pytest.raises(typer.Exit) as end:
        command(out=tmp_path, only=",".join(NAMES), **settings)
    assert end.value.exit_code == 1
    said = capsys.readouterr().out
    assert "the figure: 3 cd/m², expected at most 2 cd/m²" in said
    assert "pip install 'domesim[metrics]'" in said
    assert str(tmp_path / "report.html") in said
    stubs[NAMES[1]].found = 1.0
    command(out=tmp_path, only=",".join(NAMES), **{**settings, "json": True})
    figures = json.loads(capsys.readouterr().out)
    assert figures["passed"] is True
    assert figures["experiments"][NAMES[2]] == "not run"


@pytest.mark.long
def test_a_real_run_survives_a_kill(tmp_path):
    """The whole command, killed in the middle of one of its steps."""
    name = "photographed_crosstalk"
    line = [sys.executable, "-m", "domesim", "validate", "--quick", "--only", name]
    line += ["--out", str(tmp_path)]
    process = subprocess.Popen(line, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    steps = f".domesim-steps/{name}/*/[!.]*.json"
    while not list(tmp_path.glob(steps)) and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.kill()
    process.wait()
    kept = {file: file.stat().st_mtime_ns for file in tmp_path.glob(steps)}
    assert process.returncode == -9
    assert kept
    assert subprocess.run(line, check=False, stdout=subprocess.DEVNULL).returncode == 0
    assert len(list(tmp_path.glob(steps))) > len(kept)
    assert all(file.stat().st_mtime_ns == when for file, when in kept.items())


# ------------------------------------------------------------------------------ in the browser


def test_the_page_can_be_read_at_any_width(tmp_path, stubs, browser):
    stubs[NAMES[1]].found = 3.0
    stubs[NAMES[2]].raises = Missing("needs a telescope")
    run(tmp_path)
    page = browser.new_page(viewport={"width": 390, "height": 800})
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto((tmp_path / "report.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []
    red = page.locator("article.not-as-expected")
    assert red.count() == 1
    assert red.locator("tr.failed").inner_text().split()[:3] == ["the", "figure", "3"]
    assert red.locator("details.checks").get_attribute("open") is not None
    assert "needs a telescope" in page.locator("article.not-run").inner_text().lower()
    assert "<second>" in red.inner_text()
    page.close()
