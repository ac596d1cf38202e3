"""The study kit: plans, pictures, the folder, answers, and what they show."""

from __future__ import annotations

import csv
import shutil
import sys
from collections import Counter
from itertools import combinations, pairwise, product
from pathlib import Path

import numpy as np
import pytest
from command_line import exit_code
from statsmodels.genmod.families import Binomial
from statsmodels.genmod.generalized_linear_model import GLM

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame, write_frame
from domesim.light.transfer import named
from validation.audience import power
from validation.audience.analysis import analyse_study
from validation.audience.design import CATCH, SPOILT, TRAINING, plan
from validation.audience.files import Answer, Answers, names_of, read_study
from validation.audience.inference import audience, share_interval, sign_changes
from validation.audience.power import Situation
from validation.audience.rehearsal import answered, attentive, planned
from validation.audience.viewers import counts

MASTERS, METHODS = ("orrery", "hall", "stage"), ("none", "subtractive", "perceptual")
CIRCLE = "stereo_polarised_paper"


# Plans


def test_everybody_sees_all_pairs_as_often_in_both_orders():
    for viewer in (1, 2, 7):
        shown = Counter(
            (trial.master, trial.first, trial.second)
            for trial in plan(MASTERS, METHODS, viewer=viewer, seed=3)
            if trial.kind == "choice"
        )
        wanted = {
            (master, *pair)
            for master in MASTERS
            for a, b in combinations(METHODS, 2)
            for pair in ((a, b), (b, a))
        }
        assert shown == Counter(wanted)


def test_one_repeat_is_balanced_over_masters_and_viewers():
    firsts = Counter()
    for viewer in range(1, 9):
        for trial in plan(MASTERS, METHODS, viewer=viewer, seed=0, repeats=1):
            if trial.kind == "choice":
                firsts[trial.master, trial.first, trial.second] += 1
    assert set(firsts.values()) == {4}
    assert len(firsts) == len(MASTERS) * 6


def test_either_side_is_right_as_often_and_catch_trials_are_strewn():
    for viewer in range(1, 6):
        trials = plan(MASTERS, METHODS, viewer=viewer, seed=1)
        for kind, count in (("training", TRAINING), ("catch", CATCH)):
            right = Counter(trial.right for trial in trials if trial.kind == kind)
            assert right == {1: count // 2, 2: count // 2}
        assert {trial.kind for trial in trials[:TRAINING]} == {"training"}
        places = [k for k, trial in enumerate(trials) if trial.kind == "catch"]
        assert max(np.diff(places)) < 2 * len(trials) / CATCH
    spoilt = next(trial for trial in trials if trial.second == SPOILT)
    assert spoilt.right == 1


def test_neighbours_are_of_different_masters():
    trials = plan(MASTERS, METHODS, viewer=4, seed=2)[TRAINING:]
    assert all(a.master != b.master for a, b in pairwise(trials))
    # One master alone cannot be kept apart
    assert len(plan(["one"], METHODS, viewer=1, seed=0)) == TRAINING + CATCH + 6


def test_orders_are_the_seeds_and_the_viewers():
    first = plan(MASTERS, METHODS, viewer=1, seed=0)
    assert first == plan(MASTERS, METHODS, viewer=1, seed=0)
    assert first != plan(MASTERS, METHODS, viewer=2, seed=0)
    assert first != plan(MASTERS, METHODS, viewer=1, seed=1)


@pytest.mark.parametrize(
    ("masters", "methods", "words"),
    [
        ([], METHODS, "at least one master, got none"),
        (MASTERS, ["none"], "at least two methods, got none"),
        (["a", "a"], METHODS, "each name once, got a, a"),
    ],
)
def test_impossible_plans_are_refused(masters, methods, words):
    with pytest.raises(InputError, match=words):
        plan(masters, methods, viewer=1, seed=0)


def test_masters_have_short_names_of_their_own(tmp_path):
    paths = ["a_L.exr", "b/a_left.exr", "c/a.0001.exr", "c/a_L.0001.exr", "L.png"]
    found = names_of([tmp_path / path for path in paths])
    assert found == ["a", "a-2", "a.0001", "a.0001-2", "L"]


# Inference


def test_sign_changes_count_all_ways():
    differences = np.array([3, -1, 5, 0, 2])
    found = abs(differences.sum())
    ways = [abs(np.dot(signs, differences)) >= found for signs in product((1, -1), repeat=5)]
    assert sign_changes(differences) == pytest.approx(np.mean(ways))
    assert sign_changes([4] * 6) == pytest.approx(2 / 2**6)
    assert sign_changes([0, 0]) == 1


def test_people_who_are_alike_make_wider_intervals():
    low, high = share_interval([20, 0, 20, 20, 0, 20], [20] * 6)
    own = share_interval([13, 14, 13, 13, 14, 13], [20] * 6)
    assert low < own[0] < 80 / 120 < own[1] < high
    # Nobody differs: nothing says that choices of one are alike
    assert share_interval([20] * 6, [20] * 6) == (pytest.approx(120 / (120 + 6.607), abs=1e-3), 1)
    with pytest.raises(InputError, match="2 or more viewers, got 1"):
        share_interval([3, 0], [5, 0])


def test_errors_of_the_scale_are_those_of_statsmodels_clusters():
    random = np.random.default_rng(5)
    situation = Situation(share=0.7, spread=1.0, methods=3, each=9)
    wins = power.simulated(situation, 14, 1, random)[0]
    found = audience(wins, METHODS)
    rows, outcome, group = [], [], []
    for person, i, j in product(range(14), range(3), range(3)):
        row = np.eye(3)[i] - np.eye(3)[j]
        if i < j:
            rows += [row[1:]] * int(wins[person, i, j] + wins[person, j, i])
            outcome += [1] * int(wins[person, i, j]) + [0] * int(wins[person, j, i])
            group += [person] * int(wins[person, i, j] + wins[person, j, i])
    fit = GLM(outcome, np.array(rows), Binomial()).fit(
        cov_type="cluster", cov_kwds={"groups": np.array(group), "use_correction": False}
    )
    assert found.independent.scale.values[1:] == pytest.approx(fit.params, abs=1e-6)
    wanted = fit.bse * np.sqrt(14 / 13)
    assert found.errors[1:] == pytest.approx(wanted, rel=1e-5)
    assert found.quantile == pytest.approx(2.160, abs=1e-3)


def test_power_rises_with_viewers_and_is_none_of_five():
    situation = Situation(share=0.7, spread=0.5, methods=2, each=10)
    found = [power.power(situation, viewers, audiences=200) for viewers in (5, 8, 16)]
    assert found[0] == 0
    assert 0.3 < found[1] < found[2] <= 1
    assert power.power(situation, 8, audiences=200) == found[1]


def test_the_share_is_that_of_all_people():
    situation = Situation(share=0.8, spread=1.5, methods=2, each=50)
    wins = power.simulated(situation, 20000, 1, np.random.default_rng(0))[0]
    assert wins[:, 0, 1].mean() / 50 == pytest.approx(0.8, abs=0.006)


# Viewers


@pytest.fixture(scope="module")
def study():
    return planned(MASTERS, METHODS, viewers=10)


def test_who_presses_one_key_is_told_of_and_still_counted(study):
    random = np.random.default_rng(2)
    good = [attentive(study, n, [0.0, 0.3, 1.5], random) for n in range(1, 10)]
    found = analyse_study(study, [*good, answered(study, 10, [2] * len(study.viewers[9]))])
    *others, last = found.viewers
    assert last.told == (
        "catch trials no better than guessed",
        "chose the second picture",
    )
    assert (last.caught, last.catches, last.first) == (CATCH // 2, CATCH, 0.0)
    assert not any(one.told for one in others)
    assert all(one.caught == CATCH for one in others)
    assert found.everybody.preferences[0].viewers == 10
    assert found.without.preferences[0].viewers == 9


def test_choices_are_counted_for_what_was_chosen(study):
    sure = attentive(study, 1, [-50.0, 0.0, 50.0], np.random.default_rng(0))
    each = 2 * len(MASTERS)
    assert counts(study, sure).tolist() == [[0, 0, 0], [each, 0, 0], [each, each, 0]]


def test_who_chooses_otherwise_is_told_of(study):
    random = np.random.default_rng(2)
    many = [attentive(study, n, [0.0, 1.5, 3.0], random) for n in range(1, 10)]
    odd = attentive(study, 10, [3.0, 1.5, 0.0], random)
    found = analyse_study(study, [*many, odd])
    assert [one.told for one in found.viewers if one.told] == [("chose otherwise than the others",)]
    assert found.viewers[-1].otherwise < -3


def test_displays_that_were_off_are_told_of(study):
    random = np.random.default_rng(0)
    people = [attentive(study, n, [0, 0.5, 1], random) for n in (1, 2, 3)]
    people[0] = people[0].model_copy(update={"white": 1.5})
    people[1] = people[1].model_copy(update={"white": 1.05})
    found = analyse_study(study, people)
    assert found.displays == (
        "White is 1 cd/m²; it was more than 10% off for viewers 1 (1.5 cd/m²)",
        "No white was read for viewers 3",
    )


def test_the_papers_films_come_out_as_printed():
    """10 people, 6 films, 102 of 120 choices: chi² 58.8 (van Baar et al. 2011, section 4.1)."""
    study = planned([f"film {k}" for k in range(6)], ("perceptual", "other"), viewers=10)
    people, left = [], 18
    for number, trials in enumerate(study.viewers, 1):
        one = attentive(study, number, [50.0, 0.0], np.random.default_rng(0))
        given = list(one.answers)
        for k, trial in enumerate(trials):
            if trial.kind == "choice" and left and k % 5 == 0:
                given[k] = Answer(trial=k, choice=3 - given[k].choice)
                left -= 1
        people.append(one.model_copy(update={"answers": tuple(given)}))
    (pair,) = analyse_study(study, people).everybody.preferences
    assert (pair.wins, pair.trials, pair.significant) == (102, 120, True)
    found = analyse_study(study, people).figures()
    assert found["pearson"] == pytest.approx(58.8)


# The folder


def stripes(shift: int, rows: int = 18, cols: int = 32) -> np.ndarray:
    """A lit and a black stripe, of which a pair has a ghost that cannot be subtracted."""
    light = np.full((rows, cols, 3), 0.02, np.float32)
    light[4:9, 8 + shift : 14 + shift] = (0.9, 0.7, 0.5)
    light[12:, 4 + shift : 20 + shift] = 0
    return light


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pair")
    colour = ColourTag("srgb", "BT.709", "test")
    for eye, shift in (("L", 2), ("R", -2)):
        path = folder / f"stripes_{eye}.png"
        codes = named("srgb", white=1.0).encode(stripes(shift)).astype(np.float32)
        write_frame(Frame(np.clip(codes, 0, 1), path, colour, 16, floating=False), path, bits=16)
    return folder / "stripes_L.png", folder / "stripes_R.png"


@pytest.fixture(scope="module")
def made_once(pair, tmp_path_factory):
    out = tmp_path_factory.mktemp("made") / "study"
    new = ("study", "new", "--left", pair[0], "--right", pair[1], "--scene", CIRCLE, "--out", out)
    assert exit_code(*new, "--sittings", 2, "--viewers", 3, "--quiet") == 0
    return out


@pytest.fixture
def made(made_once, tmp_path):
    """The folder of a study, a new copy for each test."""
    return Path(shutil.copytree(made_once, tmp_path / "study"))


def test_a_folder_has_all_that_is_played_and_printed(made):
    study = read_study(made)
    assert len(study.viewers[0]) == TRAINING + CATCH + 6
    assert study.methods == METHODS
    assert list(study.masters) == ["stripes"]
    assert study.question == "Which one is more comfortable to look at?"
    for condition in (*METHODS, SPOILT):
        name = study.picture("stripes", condition)
        assert all((made / "pictures" / f"{name}_{eye}.png").is_file() for eye in "LR")
    page = (made / "index.html").read_text()
    assert not any(method in page for method in ("subtractive", "perceptual", SPOILT + '"'))
    assert "comfortable" in (made / "print.html").read_text()
    assert study.digest in (made / "preregistration.md").read_text()
    assert "6 choices" in (made / "preregistration.md").read_text()


def test_pictures_are_what_the_methods_project(made_once):
    study = read_study(made_once)

    def light(condition, eye="L"):
        name = study.picture("stripes", condition)
        codes = read_frame(made_once / "pictures" / f"{name}_{eye}.png").pixels
        return named("srgb", white=1.0).decode(codes)

    code = 1 / 255
    assert np.abs(light("none") - stripes(2)).max() < 4 * code
    ghost = (6, 7)  # lit in the right eye only
    assert light("subtractive")[ghost].max() < light("none")[ghost].max() - code
    # Both eyes and a veil
    assert light(SPOILT)[ghost].min() > 0.2


def test_a_display_shows_what_is_seen(run, pair, tmp_path):
    out = tmp_path / "display"
    figures = run(
        *("study", "new", "--left", pair[0], "--right", pair[1], "--scene", CIRCLE, "--out", out),
        *("--show", "display", "--methods", "none,subtractive", "--viewers", 2, "--json"),
    ).figures()
    study = read_study(out)
    assert figures["study"] == study.digest
    assert figures["trials"] == len(study.viewers[0])
    name = study.picture("stripes", "none")
    codes = read_frame(out / "pictures" / f"{name}_L.png").pixels
    seen = named("srgb", white=1.0).decode(codes)
    # The ghost of the right eye's stripe in what is black to the left
    assert seen[14, 3].mean() > seen[14, 10].mean() + 0.0005
    assert study.show == "display"


def test_frames_for_a_server_are_named_by_trial_and_interval(made):
    study = read_study(made)
    for number in (1, 2):
        place = made / "server" / f"sitting-{number}"
        rows = list(csv.DictReader((place / "playlist.csv").read_text().splitlines()))
        assert len(rows) == 4 * len(study.viewers[0])
        for row in rows:
            trial = study.viewers[number - 1][int(row["trial"]) - 1]
            condition = (trial.first, trial.second)[int(row["interval"]) - 1]
            eye = row["file"][-5]
            source = f"{study.picture('stripes', condition)}_{eye}.png"
            content = (place / row["file"]).read_bytes()
            assert content == (made / "server" / "frames" / source).read_bytes()


def test_answers_on_paper_and_from_the_page_are_analysed_together(made, run, monkeypatch):
    study = read_study(made)
    random = np.random.default_rng(1)
    first = attentive(study, 3, [0, 0.5, 2], random)
    (made / "answers" / "viewer-003.json").write_text(first.model_dump_json())
    lines = ["viewer,trial,choice"]
    for seat in ("A1", "A2"):
        on_paper = attentive(study, 1, [0, 0.5, 2], random)
        lines += [f"{seat},{one.trial + 1},{one.choice}" for one in on_paper.answers]
    (made / "answers" / "sitting-1.csv").write_text("\n".join(lines))
    figures = run("study", "analyse", made, "--json").figures()
    assert [one["name"] for one in figures["viewers"]] == ["3", "A1, sitting 1", "A2, sitting 1"]
    assert sum(one["trials"] for one in figures["preferences"]) == 3 * 6
    assert "perceptual" in (made / "results.html").read_text()
    monkeypatch.setitem(sys.modules, "statsmodels.genmod.families", None)
    run("study", "analyse", made).is_refused("pip install 'domesim[study]'")


def test_mistakes_are_one_line(made, pair, run, tmp_path):
    new = ("study", "new", "--scene", CIRCLE, "--out", tmp_path / "new")
    both = ("--left", pair[0], "--right", pair[1])
    run(*new).is_refused("wants masters", "got none")
    run(*new, *both, "--methods", "none,magic").is_refused("'magic' is not known")
    run("study", "analyse", tmp_path).is_refused("study.json", "domesim study new")
    run("study", "power", "--viewers", "few").is_refused("--viewers", "few")
    run("study", "analyse", made).is_refused("2 or more viewers, got 0")
    answers = made / "answers"
    (answers / "viewer-001.json").write_text("{}")
    run("study", "analyse", made).is_refused("viewer-001.json", "a viewer's answers")
    study = read_study(made)
    other = Answers(study="another", viewer=1, answers=(Answer(trial=0, choice=1),))
    (answers / "viewer-001.json").write_text(other.model_dump_json())
    run("study", "analyse", made).is_refused("those of another")
    (answers / "viewer-001.json").unlink()
    (answers / "sitting-1.csv").write_text("viewer,trial,choice\nA1,1,3\n")
    run("study", "analyse", made).is_refused("sitting-1.csv, line 2", "choice (1 or 2)")
    (answers / "sitting-1.csv").write_text("viewer,trial,choice\nA1,1,1\n")
    run("study", "analyse", made).is_refused(f"all {len(study.viewers[0])} answers of viewer A1")
    run(*new[:-1], made, *both).is_refused("a study that viewers took part in")


def test_power_is_told(run):
    found = run(
        *("study", "power", "--share", 0.7, "--masters", 5, "--viewers", "5,12,24", "--json"),
        *("--audiences", 200),
    ).figures()
    assert found["power"]["5"] == 0
    assert found["power"]["12"] < found["power"]["24"]
    assert found["enough"] == 24
    assert found["each"] == 10


def test_answers_have_no_gaps():
    with pytest.raises(ValueError, match="0, 1, 2"):
        Answers(study="x", viewer=1, answers=(Answer(trial=1, choice=1),))
