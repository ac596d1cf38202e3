"""What experiments expect of the default turns red where it does harm."""

from __future__ import annotations

from dataclasses import replace

import pytest

from validation.experiments import domes_in_3d, fig10_seats, flat_cinema, stray_light, two_eyes


def red(checks) -> list[str]:
    return [check.what for check in checks if not check.passed]


def pairs(**default):
    """Twelve pairs at one crosstalk, where the default is as good as subtraction but for that."""
    good = two_eyes.Cell(0.1, 0.2, 0.01, 9.9)
    nothing = two_eyes.Cell(0.3, 0.8, 0.02, 9.7)
    return {
        (f"pair {number}", two_eyes.USUAL, way): (
            nothing if way == two_eyes.NOTHING else replace(good, **changed)
        )
        for number in range(12)
        for way in two_eyes.WAYS
        for changed in [default if way == two_eyes.DEFAULT else {}]
    }


def test_the_default_of_pairs_may_not_be_worse_than_nothing_or_subtraction():
    rises = {"pair": two_eyes.Rise([0.0, 0.1], [0.0, 0.1], [0.0, 0.1])}

    def found(**default):
        return red(two_eyes._checks(rises, pairs(**default), quick=False))

    assert found() == []
    for figure, name in (("fused_loss", "fused loss"), ("contrast", "contrast")):
        assert found(**{figure: 0.9}) == [
            f"{name}: default less nothing, over pairs",
            f"{name}: default less subtraction, lower end of the interval",
        ]
    assert found(rivalry=0.015) == ["rivalry: default less subtraction, lower end of the interval"]
    assert found(judged=9.87) == ["pairs 0.02 JOD short of the better of nothing and subtraction"]


def test_one_pair_of_twelve_may_be_short():
    rises = {"pair": two_eyes.Rise([0.0, 0.1], [0.0, 0.1], [0.0, 0.1])}
    cells, short = pairs(), pairs(judged=9.8)
    for number, expected in ((0, 0), (1, 1)):
        key = f"pair {number}", two_eyes.USUAL, two_eyes.DEFAULT
        cells[key] = short[key]
        assert len(red(two_eyes._checks(rises, cells, quick=False))) == expected


def test_a_film_s_frame_may_not_be_harmed_nor_its_black_lifted():
    def found(gains, black):
        ways = dict.fromkeys(flat_cinema.WAYS, 1.0)
        shown = {"night": flat_cinema.Shown(ways, ways, {**ways, flat_cinema.AIMED: black})}
        return red(flat_cinema._harmless({"cinema": gains}, shown, quick=False))

    assert found([0.1, -0.019], 1.0) == []
    assert found([0.1, -0.021], 0.9) == ["cinema: quality that it gains, least"]
    assert found([0.01, -0.015], 0.9) == ["cinema: quality that the aim gains, mean of the frames"]
    assert found([0.1], 1.01) == ["black of the aim over untouched, most of all"]


@pytest.mark.parametrize(
    ("lost", "light", "expected"),
    [
        ((0.5, 0.51, 0.53, 0.53), 1.2, []),
        ((0.5, 0.51, 0.51, 0.53), 1.2, ["crosstalk only: quality lost beyond both's, mean"]),
        ((0.5, 0.53, 0.53, 0.53), 1.2, ["reflected light only: quality lost beyond both's, mean"]),
        (
            (0.5, 0.51, 0.53, 0.53),
            1.31,
            ["light that is seen, both answered over untouched, most"],
        ),
    ],
)
def test_a_3d_dome_may_not_be_brighter_nor_lose_more_than_one_answer(lost, light, expected):
    ways = domes_in_3d.WAYS
    seen = domes_in_3d.Seen(
        0.0,
        dict(zip(ways, lost, strict=True)),
        {**dict.fromkeys(ways, 1.3), domes_in_3d.BOTH: light},
        dict(zip(ways, (0.0, 1.0, 0.0, 1.0), strict=True)),
    )
    paint = domes_in_3d.Paint((1.0, 0.5), (0.1, 0.1), (1.0, 0.5), 0.5)
    losses = {way: [seen.lost[way] - seen.lost[domes_in_3d.BOTH]] for way in ways[1:]}
    checks = domes_in_3d._checks(
        {"paint": paint}, {"metal": -0.7}, {"night": seen}, losses, quick=False
    )
    assert red(checks) == expected


@pytest.mark.parametrize(
    ("visible", "expected"),
    [
        (0.28, []),
        (0.31, ["screen with visible pollution at 45 years over no stray light"]),
        (0.14, ["screen with visible pollution at 45 years over no stray light"]),
    ],
)
def test_the_eye_s_own_light_hides_some_pollution_and_not_most(visible, expected):
    shares = {25: 0.16, 45: 0.19, 70: 0.36}
    seen = stray_light.Seen(shares, {0: 0.3, **dict.fromkeys(stray_light.AGES, visible)})
    checks = stray_light._checks(stray_light.Work(quick=False), {"one": seen}, seen)
    assert red(checks) == expected


@pytest.mark.parametrize(("gain", "expected"), [(0.001, 0), (-0.001, 1)])
def test_the_default_of_all_seats_may_not_lose_more_than_untouched(gain, expected):
    nothing = dict.fromkeys(fig10_seats.SEATS, 0.5)
    default = {**nothing, "left": 0.5 - gain}
    seen = {
        name: fig10_seats.Seen({}, {}, lost, 0.0)
        for name, lost in (("none", nothing), ("default", default))
    }
    assert len(red([fig10_seats._harmless([fig10_seats.Outcome({}, seen, ())])])) == expected
