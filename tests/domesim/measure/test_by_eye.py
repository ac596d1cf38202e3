"""Settings of made-up viewers -> crosstalk and albedo, and a scene that knows how sure they are."""

from __future__ import annotations

import threading
import urllib.error
import urllib.request

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.measure.by_eye.albedo import albedos_of, answering_levels
from domesim.measure.by_eye.estimate import estimated
from domesim.measure.by_eye.page import server
from domesim.measure.by_eye.session import (
    SETTINGS,
    Session,
    blocks_of,
    counted,
    read_session,
    trials_of,
)
from domesim.scene import load_dome, load_scene
from testing.viewers import Display, Room, Viewer

PAIR, DOME = "stereo_polarised_paper", "dome_hemisphere"
SHARES = {
    "stereo": {
        "left": {"R": 0.011, "G": 0.008, "B": 0.02},
        "right": {"R": 0.03, "G": 0.015, "B": 0.005},
    },
    "dome": {"both": {"R": 0.16, "G": 0.13, "B": 0.08}},
}


def room(kind, *displays):
    eyes = SHARES[kind]
    return Room(kind, dict(zip(eyes, displays, strict=True)), SHARES[kind], 40.0)


def viewer(seed=0, **changes):
    """Sees everything, unless something is changed."""
    person = {"skill": 1e-3, "early": (0.0, 0.0), "learning": 0.0, "slips": 0.0} | changes
    return Viewer(np.random.default_rng(seed), **person)


DISPLAYS = {
    "stereo": (Display(2.3, srgb=False), Display(1.0, srgb=True)),
    "dome": (Display(1.0, srgb=True),),
}


def truth(kind):
    return np.array([list(shares.values()) for shares in SHARES[kind].values()])


def values(kind, who):
    found = estimated(counted(room(kind, *DISPLAYS[kind]).session(who)))
    return found, np.array([each.value for each in found.shares])


@pytest.mark.parametrize("kind", ["stereo", "dome"])
def test_perfect_eyes_find_shares_whatever_the_display(kind):
    found, value = values(kind, viewer())
    np.testing.assert_allclose(value, truth(kind), rtol=0.04)  # sRGB ends in a straight line
    assert found.slips == 0


def test_matched_codes_tell_the_response():
    found, _ = values("stereo", viewer())
    codes = np.linspace(0.13, 1, 12)
    for shares, display in zip(found.shares, DISPLAYS["stereo"], strict=True):
        light = [display.light(float(code)) for code in codes]
        np.testing.assert_allclose(shares.response.light(codes), light, rtol=0.015)
    np.testing.assert_allclose(found.shares[0].response.gammas, 2.3, atol=0.005)


@pytest.mark.parametrize(("stated", "told"), [(None, 0), (2.3, 1), (1.8, 2), ("srgb", 1)], ids=str)
def test_a_response_that_is_stated_otherwise_is_told(stated, told):
    """One eye's display has a gamma of 2.3, the other one's is sRGB."""
    from domesim.measure.by_eye.result import Result  # noqa: PLC0415 - SciPy

    projector = {} if stated is None else {"response": stated}
    scene = load_scene(PAIR, projector=projector)
    lines = Result(scene, room("stereo", *DISPLAYS["stereo"]).session(viewer())).lines()
    other = [line for line in lines if "[projector] response says" in line]
    assert len(other) == told
    if stated == 1.8:
        assert "says gamma 1.8, which gives 1.4 times that light there, at 1/4 of white" in other[0]


@pytest.mark.parametrize("kind", ["stereo", "dome"])
def test_what_is_alike_on_both_sides_cancels(kind):
    _, once = values(kind, viewer(skill=1.0, early=(0.0, 0.0)))
    found, early = values(kind, viewer(skill=1.0, early=(4.0, 4.0)))
    np.testing.assert_allclose(early, once, rtol=0.05)
    assert found.apart > 0.05


def test_a_bias_of_one_side_widens_intervals():
    alike, _ = values("dome", viewer(skill=1.0))
    biased, value = values("dome", viewer(skill=1.0, early=(0.0, 4.0)))
    off = np.abs(value - truth("dome"))[0]
    assert (biased.shares[0].error > 1.5 * alike.shares[0].error).all()
    assert (off < 1.96 * biased.shares[0].error).all()


def test_slips_are_left_out():
    seen = viewer(skill=0.5)
    session = room("dome", *DISPLAYS["dome"]).session(seen)
    before = estimated(counted(session))
    places = [k for k, trial in enumerate(trials_of("dome")) if trial.counted and trial.block == 3]
    settings = list(session.settings)
    settings[places[2]] = settings[places[2]].model_copy(update={"code": 0.9})
    after = estimated(counted(session.model_copy(update={"settings": tuple(settings)})))
    assert (before.slips, after.slips) == (0, 1)
    np.testing.assert_allclose(after.shares[0].value, before.shares[0].value, rtol=0.02)


def test_learning_is_told(tmp_path, run):
    """A viewer whose settings rise by 5 % of light from one to the next."""
    session = room("dome", *DISPLAYS["dome"]).session(viewer(skill=0.3))
    assert abs(estimated(counted(session)).learning) < 0.03
    trials, blocks = trials_of("dome"), blocks_of("dome")
    settings = []
    for setting in session.settings:
        mine = blocks[trials[setting.trial].block].task == "null"
        code = setting.code * 1.05 ** (setting.trial % 7 / 2.2 if mine else 0)
        settings.append(setting.model_copy(update={"code": code}))
    risen = session.model_copy(update={"settings": tuple(settings)})
    found = estimated(counted(risen))
    assert 0.2 < found.learning < 0.35
    assert found.learning > 5 * found.learning_error
    told = stored(risen, DOME, tmp_path, run).out
    assert "the viewer was still learning, or tired" in told


def test_light_that_the_dome_reflects_tells_its_albedo():
    bare = load_dome(DOME)
    half = bare.dome.screen_area / (4 * np.pi * bare.dome.radius**2) / 2
    albedo = np.array([0.5, 0.4, 0.1])
    answers = answering_levels(bare, albedo)
    np.testing.assert_allclose(answers, albedo * half / (1 - albedo * half), rtol=1e-6)
    found, slope = albedos_of(bare, answers)
    np.testing.assert_allclose(found, albedo, rtol=1e-6)
    near, _ = albedos_of(bare, answers * 1.01)
    np.testing.assert_allclose((near - found) / (0.01 * answers), slope, rtol=0.02)
    with pytest.raises(InputError, match="no screen there reflects"):
        albedos_of(bare, np.array([0.2, 0.9, 0.2]))


def test_a_floor_counts():
    content = {"floor": {"height_m": 0.0, "albedo": 0.3}}
    floored = load_scene(DOME, **content)
    albedo = np.array([0.5, 0.4, 0.3])
    answers = answering_levels(floored, albedo)
    assert (answers > 1.02 * answering_levels(load_dome(DOME), albedo)).all()
    found, _ = albedos_of(floored, answers)
    np.testing.assert_allclose(found, albedo, rtol=1e-3)


def stored(session, scene, folder, run):
    """What the command says of settings that are all there."""
    digest = load_scene(scene).digest
    session = session.model_copy(update={"digest": digest, "scene": scene})
    out = folder / "out"
    out.mkdir()
    (out / SETTINGS).write_text(session.model_dump_json())
    return run("measure", "by-eye", f"--{session.kind}", scene, "--out", out)


def test_a_pair_carries_its_errors(tmp_path, run):
    session = room("stereo", *DISPLAYS["stereo"]).session(viewer(skill=1.0))
    told = stored(session, PAIR, tmp_path, run)
    assert "crosstalk to the left eye: R 1." in told.out
    assert "no learning is seen" in told.out
    measured = load_scene(tmp_path / "out" / "measured.toml")
    matrices = measured.seats["sweet spot"].matrices
    diagonals = np.array([np.diag(each) for each in matrices])
    np.testing.assert_allclose(diagonals, truth("stereo"), rtol=0.2)
    changes = measured.seats["sweet spot"].uncertainty
    assert len(changes) == 6
    again = run("measure", "by-eye", "--scene", PAIR, "--out", tmp_path / "out", "--json").figures()
    errors = np.array([again["eyes"][eye]["standard_error"] for eye in ("left", "right")])
    np.testing.assert_allclose(np.abs(changes).sum((0, 3)), errors, rtol=1e-4)
    # Other seats keep their map
    assert measured.seats["left"].share.max() > 1.5


def test_a_dome_carries_its_errors(tmp_path, run):
    session = room("dome", *DISPLAYS["dome"]).session(viewer(skill=1.0))
    told = stored(session, DOME, tmp_path, run)
    assert "screen albedo: R " in told.out
    measured = load_dome(tmp_path / "out" / "measured.toml")
    wanted, _ = albedos_of(load_dome(DOME), truth("dome")[0])
    np.testing.assert_allclose(measured.albedo, wanted, rtol=0.1)
    assert all(0.005 < each < 0.5 for each in measured.reflected_error)
    correlation = np.array(list(measured.measured.correlations.values()))
    assert (correlation[0, 1:] > 0.02).all()  # one response for all
    assert "known within ±" in measured.facts()["Measured"]


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ("autostereo_8", ("wanted a dome or a 3D screen of two views",)),
        ("cinema_2d", ("wanted a dome or a 3D screen of two views",)),
    ],
)
def test_what_it_cannot_measure_is_refused_at_once(tmp_path, run, scene, words):
    run("measure", "by-eye", "--scene", scene, "--out", tmp_path / "out").is_refused(*words)


def test_settings_of_another_scene_are_refused(tmp_path, run):
    session = room("dome", *DISPLAYS["dome"]).session(viewer())
    stored(session, DOME, tmp_path, run)
    other = run("measure", "by-eye", "--scene", "dome_imax", "--out", tmp_path / "out")
    other.is_refused("settings.json", f"of the scene {DOME}", "another folder")
    (tmp_path / "out" / SETTINGS).write_text('{"kind": "dome"}')
    wrong = run("measure", "by-eye", "--scene", DOME, "--out", tmp_path / "out")
    wrong.is_refused("settings.json", "got something else")


@pytest.fixture
def served(tmp_path):
    """A server of a dome's page in this folder: its thread, and how to ask it."""
    running = server(tmp_path, "dome", "a dome", "", 0)
    thread = threading.Thread(target=running.serve_forever, args=(0.05,))
    thread.start()

    def asked(path, data=None, **headers):
        address = f"http://127.0.0.1:{running.server_address[1]}{path}"
        request = urllib.request.Request(address, data=data, headers=headers)
        try:
            with urllib.request.urlopen(request) as reply:
                return reply.status
        except urllib.error.HTTPError as error:
            error.close()
            return error.code

    yield thread, asked
    running.shutdown()
    thread.join()
    running.server_close()


def test_a_server_keeps_settings_loses_none_and_ends(tmp_path, served):
    thread, asked = served
    whole = room("dome", *DISPLAYS["dome"]).session(viewer())
    part, longer = (
        whole.model_copy(update={"settings": whole.settings[:count]}) for count in (5, 8)
    )

    def post(session, **headers):
        return asked("/settings", session.model_dump_json().encode(), **headers)

    assert asked("/") == 200
    assert (asked("/settings"), asked("/settings.json"), asked("/x", b"{}")) == (204, 404, 400)
    assert post(longer, Origin="http://elsewhere.example") == 400
    assert (post(longer), post(part), post(longer)) == (204, 409, 204)
    assert post(whole.model_copy(update={"digest": "another"})) == 409
    assert asked("/settings", b'{"kind": "dome"}') == 409
    assert asked("/settings") == 200
    assert len(read_session(tmp_path / SETTINGS, "dome", "").settings) == 8
    assert post(whole) == 204
    thread.join(20)
    assert not thread.is_alive()
    assert read_session(tmp_path / SETTINGS, "dome", "").done


def test_settings_out_of_order_are_refused():
    whole = room("dome", *DISPLAYS["dome"]).session(viewer())
    settings = [whole.settings[0], whole.settings[2]]
    with pytest.raises(ValueError, match="wanted trial 1"):
        Session(**{**whole.model_dump(), "settings": settings})


def test_a_ghost_beyond_the_grey_is_asked_again():
    """Crosstalk of 15 %: the first grey is of 10 %."""
    strong = {eye: dict.fromkeys("RGB", 0.15) for eye in ("left", "right")}
    place = Room("stereo", dict(zip(strong, DISPLAYS["stereo"], strict=True)), strong, 40.0)
    session = place.session(viewer())
    assert any(each.limit for each in session.settings)
    for shares in estimated(counted(session)).shares:
        np.testing.assert_allclose(shares.value, 0.15, rtol=0.03)
