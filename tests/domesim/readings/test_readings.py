"""Measurements: a known rig is found again, uncertainties are honest, bad tables are refused."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from rigs import BLACK, CRT, LEFT, NOISE, RAMP, RIGHT, TO_LEFT, TO_RIGHT, Rig, real
from scipy import stats
from scipy.spatial import ConvexHull

from domesim.errors import InputError
from domesim.light.transfer import Gamma, MeasuredTable
from domesim.readings.crosstalk import measured_crosstalk
from domesim.readings.gamut import common_gamut
from domesim.readings.grey_to_grey import in_light, read_grey_to_grey
from domesim.readings.meter import read_readings
from domesim.readings.noise import Noise, estimated_noise
from domesim.readings.pair import measured_pair
from domesim.readings.response import measured_display, uv


@pytest.fixture
def read(tmp_path):
    def reader(text, name="rig.csv", **options):
        path = tmp_path / name
        path.write_text(text)
        return read_readings(path, **options)

    return reader


def refused(call, *expected):
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    for part in expected:
        assert part in message, message
    return message


# A known rig


def test_a_known_rig_is_found_again(read):
    pair = measured_pair(read(Rig().csv()))
    assert pair.matrices == pytest.approx(np.stack([TO_LEFT, TO_RIGHT]), abs=1e-6)
    for display, own, eye in zip(pair.displays, (LEFT, RIGHT), BLACK, strict=True):
        assert display.primaries == pytest.approx(own, rel=1e-5)
        assert display.white == pytest.approx(own.sum(axis=1), rel=1e-5)
        assert display.black == pytest.approx(BLACK[eye], rel=1e-5)
        assert display.additivity == pytest.approx(0, abs=1e-5)
        assert display.contrast == pytest.approx(own[1].sum() / BLACK[eye][1] + 1, rel=1e-5)
        assert display.drift.max() < 1e-5
    for response in pair.responses:
        assert isinstance(response.transfer, Gamma)
        assert response.transfer.exponent == pytest.approx(2.2, abs=1e-5)
    assert pair.crosstalk[0].black == pytest.approx(BLACK["left"], rel=1e-5)


def test_toml_says_the_same_as_csv(read):
    rows = [
        "[[reading]]\n"
        f'projector = "{p}"\nfilter = "{f}"\nchannel = "{c}"\nlevel = {level}\n'
        f"X = {x}\nY = {y}\nZ = {z}\n"
        for p, f, c, level, x, y, z in Rig().rows()
    ]
    toml = measured_pair(read("\n".join(rows), "rig.toml"))
    assert toml.matrices == pytest.approx(measured_pair(read(Rig().csv())).matrices, abs=1e-8)
    wrong = [*rows[:3], rows[3].replace('channel = "', 'channel = "x')]
    refused(lambda: read("\n".join(wrong), "rig.toml"), "line 28: channel must be")
    subtracted = read('black = "subtracted"\n' + "\n".join(rows), "rig.toml")
    assert subtracted.black == "subtracted"
    refused(lambda: read('white = "d65"\n' + rows[0], "rig.toml"), "'white' is not known")


def test_levels_may_be_left_out(read):
    rows = [",".join([*row[:3], *map(str, row[4:])]) for row in Rig(ramps=False).rows()]
    pair = measured_pair(read("\n".join(["projector,filter,channel,X,Y,Z", *rows])))
    assert pair.matrices[0] == pytest.approx(TO_LEFT, abs=1e-6)
    assert pair.responses == (None, None)
    assert any("no ramps" in line for line in pair.report())


def test_ramps_may_be_read_without_a_filter(read):
    text = Rig(ramps=False).csv()
    for eye, own in (("left", 2 * LEFT), ("right", 2 * RIGHT)):
        rows = [("K", 0.0, np.zeros(3))]
        rows += [
            (c, x, own[:, i] * x**2.4) for (i, c), x in product(enumerate("RGB"), [*RAMP, 1.0])
        ]
        text += "".join(f"\n{eye},none,{c},{x},{','.join(map(str, xyz))}" for c, x, xyz in rows)
    pair = measured_pair(read(text))
    assert [r.transfer.exponent for r in pair.responses] == pytest.approx([2.4, 2.4], abs=1e-4)


def test_black_that_was_subtracted_is_not_subtracted_again(read):
    lines = ["channel,X,Y,Z", "R,20,10,1", "G,15,30,5", "B,8,3,40", "W,43,43,46", "K,0.1,0.1,0.1"]
    kept = measured_display(read("\n".join(lines)).session("display", "none"))
    gone = measured_display(read("\n".join(lines), black="subtracted").session("display", "none"))
    assert kept.primaries[:, 0] == pytest.approx([19.9, 9.9, 0.9])
    assert gone.primaries[:, 0] == pytest.approx([20, 10, 1])
    # W - R - G - B is 0 as read, and 2 K after subtraction
    assert gone.additivity == pytest.approx(0)
    assert kept.additivity == pytest.approx(0.2 / np.array([42.9, 42.9, 45.9]))


def test_a_colour_at_level_0_is_black(read):
    lines = ["channel,level,X,Y,Z", "R,1,20,10,1", "G,1,15,30,5", "B,1,8,3,40"]
    lines += ["R,0,0.1,0.1,0.1", "G,0,0.1,0.1,0.13"]
    assert one(read("\n".join(lines))).black == pytest.approx([0.1, 0.1, 0.115])


def test_the_report_names_everything(read):
    lines = "\n".join(measured_pair(read(Rig().csv())).report())
    for part in (
        "gamma 2.200",
        "contrast",
        "system",
        "viewer",
        "common gamut: white",
        "W against R + G",
    ):
        assert part in lines


# Honest uncertainties

DRAWS = 300


def assert_covered(inside, probability, draws=DRAWS, alarms=1e-3):
    """Counts of intervals that hold the truth are binomial."""
    inside = np.atleast_1d(inside)
    low, high = stats.binom.interval(1 - alarms / inside.size, draws, probability)
    assert low <= inside.min(), f"{inside} of {draws} inside, wanted {low:.0f} to {high:.0f}"
    assert inside.max() <= high, f"{inside} of {draws} inside, wanted {low:.0f} to {high:.0f}"


@pytest.fixture(scope="module")
def draws(tmp_path_factory):
    """Many measurements of one rig, whose noise is known only from three repeats of each."""
    path = tmp_path_factory.mktemp("draws") / "rig.csv"
    rig = Rig(noise=NOISE, repeats=3, ramps=False)
    results = []
    for seed in range(DRAWS):
        path.write_text(rig.csv(seed))
        results.append(measured_pair(read_readings(path), allow_negative=True))
    return results


@pytest.mark.long
@pytest.mark.parametrize("sigmas", [1.0, 2.0])
def test_standard_errors_of_crosstalk_cover_the_truth(draws, sigmas):
    truth = (TO_LEFT, TO_RIGHT)
    for eye in range(2):
        found = np.stack([pair.crosstalk[eye].measured for pair in draws])
        error = np.stack([pair.crosstalk[eye].error for pair in draws])
        inside = (np.abs(found - truth[eye]) <= sigmas * error).sum(axis=0)
        assert_covered(inside, stats.chi2.cdf(sigmas**2, 1))


@pytest.mark.long
def test_the_error_of_system_crosstalk_covers_the_truth(draws):
    for eye, (own, leak) in enumerate([(LEFT, TO_LEFT), (RIGHT, TO_RIGHT)]):
        truth = (own @ leak)[1].sum() / own[1].sum()
        inside = [
            abs(p.crosstalk[eye].system - truth) <= p.crosstalk[eye].system_error for p in draws
        ]
        assert_covered(sum(inside), stats.chi2.cdf(1, 1))


@pytest.mark.long
def test_the_error_of_additivity_covers_the_truth(draws):
    leaks = [pair.leaks[0] for pair in draws]
    inside = [np.abs(leak.additivity) <= leak.additivity_error for leak in leaks]
    assert_covered(np.sum(inside, axis=0), stats.chi2.cdf(1, 1))


@pytest.mark.parametrize("white", [1.0, None], ids=["white is read", "white is a sum"])
def test_first_order_errors_are_the_derivatives(read, white):
    """With much crosstalk, where the errors of the intended primaries count too."""
    noise, to_left = Noise(0.02, 0.01), tuple(map(tuple, 12 * TO_LEFT))
    readings = read(Rig(ramps=False, to_left=to_left, white=white).csv(), noise=noise)
    leak = leak_of(readings)
    variance, system = np.zeros((3, 3)), 0.0
    for i, row in enumerate(readings.rows):
        for axis, sigma in enumerate(np.sqrt(noise.variance(np.array(row.xyz)))):
            step = 1e-3 * sigma
            xyz = tuple(np.array(row.xyz) + step * np.eye(3)[axis])
            rows = (*readings.rows[:i], replace(row, xyz=xyz), *readings.rows[i + 1 :])
            moved = leak_of(replace(readings, rows=rows))
            variance += ((moved.measured - leak.measured) / 1e-3) ** 2
            system += ((moved.system - leak.system) / 1e-3) ** 2
    assert leak.error == pytest.approx(np.sqrt(variance), rel=2e-3)
    # White and black are read on both sides
    assert leak.system_error == pytest.approx(np.sqrt(system), rel=2e-3)


@pytest.mark.long
def test_the_error_of_gamma_covers_the_truth(tmp_path):
    path = tmp_path / "rig.csv"
    inside = np.zeros(3)
    for seed in range(DRAWS):
        rig = Rig(noise=NOISE)
        path.write_text(rig.csv(seed + 10_000))
        readings = read_readings(path, noise=NOISE)
        response = measured_display(readings.session("left", "left")).response
        inside += np.abs(response.exponents - 2.2) <= response.errors
    assert_covered(inside, stats.chi2.cdf(1, 1))


def test_repeats_tell_both_terms_of_the_noise():
    rng = np.random.default_rng(4)
    found = []
    for _ in range(40):
        groups = []
        for mean in np.geomspace(0.01, 100, 30):
            xyz = mean * np.array([1.0, 1.3, 0.4])
            groups.append(xyz + rng.standard_normal((4, 3)) * np.sqrt(NOISE.variance(xyz)))
        noise = estimated_noise(groups, Noise())
        found.append([noise.relative, noise.absolute])
    assert np.mean(found, axis=0) == pytest.approx([NOISE.relative, NOISE.absolute], rel=0.05)


def test_few_or_identical_repeats_tell_nothing():
    stated = Noise(0.02, 0.01)
    assert estimated_noise([np.ones((3, 3))] * 2, stated) is stated
    assert estimated_noise([np.ones((3, 3))] * 20, stated) is stated
    refused(lambda: Noise(-0.1, 0.1), "got -0.1 and 0.1")
    refused(lambda: Noise(0.1, 0.0), "above 0 cd/m², got 0.1 and 0")


# Independent formulas


def test_colour_science_agrees(read):
    colour = pytest.importorskip("colour")
    display = measured_pair(read(Rig().csv())).displays[0]
    xy = display.chromaticities
    assert xy[:3] == pytest.approx(colour.XYZ_to_xy(LEFT.T), abs=1e-6)
    assert xy[3] == pytest.approx(colour.XYZ_to_xy(LEFT.sum(axis=1)), abs=1e-6)
    # Chromaticities and white luminance alone rebuild the matrix.
    rebuilt = colour.normalised_primary_matrix(xy[:3], xy[3]) * display.white[1]
    assert rebuilt == pytest.approx(display.primaries, rel=1e-5)
    assert uv(LEFT.T) == pytest.approx(colour.Luv_to_uv(colour.XYZ_to_Luv(LEFT.T)), abs=1e-9)


def test_srgb_and_p3_share_srgb():
    colour = pytest.importorskip("colour")
    spaces = colour.RGB_COLOURSPACES
    srgb = 80 * spaces["sRGB"].matrix_RGB_to_XYZ
    p3 = 100 * spaces["P3-D65"].matrix_RGB_to_XYZ
    gamut = common_gamut(srgb, p3)
    # P3's red and blue do not hold quite all of sRGB's.
    assert gamut.chromaticities[:3] == pytest.approx(spaces["sRGB"].primaries, abs=1e-3)
    assert gamut.white[1] == pytest.approx(80, rel=1e-3)
    assert gamut.lost == pytest.approx([0, 0.2], abs=1e-3)
    assert gamut.matrices[1] == pytest.approx(0.8 * np.linalg.solve(p3 / 100, srgb / 80), abs=2e-3)


WOODS = """projector,filter,channel,X,Y,Z
left,left,R,4,2.5,0
left,left,G,3,6.5,1
left,left,B,2,1.5,9
left,left,W,9,9.5,10
left,left,K,0,0.5,0
right,left,R,0.08,0.54,0
right,left,G,0.06,0.62,0.02
right,left,B,0.04,0.52,0.18
right,left,W,0.18,0.68,0.20
right,left,K,0,0.5,0
"""


def leak_of(readings, **options):
    own, other = (measured_display(readings.session(p, "left")) for p in ("left", "right"))
    return measured_crosstalk("left", own, other, **options)


def test_woods_by_hand(read):
    leak = leak_of(read(WOODS))
    # (L_KW - L_KK)/(L_WK - L_KK) = (0.68 - 0.5)/(9.5 - 0.5)
    assert leak.system == pytest.approx(0.02)
    assert leak.extinction == pytest.approx(50)
    assert leak.matrix == pytest.approx(0.02 * np.eye(3), abs=1e-9)
    # White leaks 0.18 cd/m² on a grey of 4.5; green leaks 0.12 on a red of 2.
    assert leak.viewer((0.5, 0.5, 0.5), (1, 1, 1)) == pytest.approx(0.04)
    assert leak.viewer((1, 0, 0), (0, 1, 0)) == pytest.approx(0.06)
    refused(lambda: leak.viewer((0, 0, 0), (1, 1, 1)), "needs light", "system crosstalk")


def test_black_of_both_is_the_mean_or_the_sum(read):
    assert leak_of(read(WOODS)).black == pytest.approx([0, 0.5, 0])
    alone = WOODS
    for before, after in [(".54", ".05"), (".62", ".13"), (".52", ".03"), (".68", ".19")]:
        alone = alone.replace(f"0{before},", f"0{after},")
    leak = leak_of(read(alone.replace("right,left,K,0,0.5,0", "right,left,K,0,0.01,0")))
    assert leak.system == pytest.approx(0.02)
    assert leak.black == pytest.approx([0, 0.51, 0])
    assert any("black differs" in note for note in leak.notes)


def test_grey_to_grey_by_hand(read, tmp_path):
    path = tmp_path / "grey.csv"
    rows = {
        (0, 0): 1,
        (0, 0.5): 1.4,
        (0, 1): 2,
        (0.5, 0): 21,
        (0.5, 0.5): 21.2,
        (0.5, 1): 21.4,
        (1, 0): 101,
        (1, 0.5): 100.9,
        (1, 1): 100.8,
    }
    lines = [f"left,{a},{b},{y}" for (a, b), y in rows.items()]
    path.write_text("\n".join(["filter,own_level,other_level,Y", *lines]))
    table = read_grey_to_grey(path)["left"]
    assert table.system == pytest.approx(0.01)
    assert table.light == pytest.approx([0, 0.2, 1])
    assert table.extra == pytest.approx(
        np.array([[0, 0.004, 0.01], [0, 0.002, 0.004], [0, -0.001, -0.002]])
    )
    assert "+1.00% of white, own level 0, other level 1" in table.report()[0]
    path.write_text("\n".join(["filter,own_level,other_level,Y", *lines[:-2]]))
    refused(lambda: read_grey_to_grey(path), "own_level 1, other_level 0.5", "other_level 1")
    swapped = [*lines[:3], lines[3].replace(",21", ",0.9"), *lines[4:], "left,0,0,9", "up,2,-1,x"]
    path.write_text("\n".join(["filter,own_level,other_level,Y", *swapped]))
    refused(
        lambda: read_grey_to_grey(path),
        "4 mistakes",
        "line 12: filter must be left or right",
        "line 12: own_level must be 0 to 1",
        "line 12: other_level must be 0 to 1",
        "line 12: Y must be a number",
    )
    path.write_text("\n".join(["filter,own_level,other_level,Y", *swapped[:-1]]))
    refused(lambda: read_grey_to_grey(path), "line 11: must repeat line 2")
    path.write_text("\n".join(["filter,own_level,other_level,Y", *swapped[:-2]]))
    refused(lambda: read_grey_to_grey(path), "line 5: left filter: light must rise")


def test_grey_to_grey_over_light_holds_what_was_measured(read, tmp_path):
    path = tmp_path / "grey.csv"
    codes = (0, 0.3, 0.6, 1)
    rng = np.random.default_rng(9)
    lines = ["filter,own_level,other_level,Y"]
    for eye, white, gamma in (("left", 50, 2.2), ("right", 40, 1.9)):
        for own, other in product(codes, codes):
            light = white * own**gamma + 0.5 * other * (1 + rng.random()) + 0.1
            lines.append(f"{eye},{own},{other},{light}")
    path.write_text("\n".join(lines))
    tables = read_grey_to_grey(path)
    levels, extra = in_light(tables["left"], tables["right"])
    assert levels[0] == 0
    assert levels[-1] == 1
    assert (np.diff(levels) > 0).all()
    own, other = (np.searchsorted(levels, tables[eye].light - 1e-6) for eye in ("left", "right"))
    assert extra[0][np.ix_(own, other)] == pytest.approx(tables["left"].extra, abs=1e-6)
    assert extra[1][np.ix_(other, own)] == pytest.approx(tables["right"].extra, abs=1e-6)
    assert extra[:, :, 0] == pytest.approx(0, abs=1e-12)
    pair = measured_pair(read(Rig().csv()), grey_to_grey=tables)
    assert sum(line.startswith("grey-to-grey crosstalk to the") for line in pair.report()) == 2


# Common gamut


def test_common_light_stays_within_both_projectors():
    rng = np.random.default_rng(5)
    corners = np.array(list(product((0, 1), repeat=3)))
    colours = np.concatenate([corners, rng.random((1000, 3))])
    for _ in range(50):
        left, right = (
            rng.uniform(0.3, 1.5) * m * rng.uniform(0.8, 1.25, (3, 3)) for m in (LEFT, RIGHT)
        )
        gamut = common_gamut(left, right)
        seen = []
        for own, matrix in zip((left, right), gamut.matrices, strict=True):
            light = colours @ matrix.T
            assert light.min() >= 0
            assert light.max() <= 1 + 1e-12
            seen.append(light @ own.T)
        assert seen[0] == pytest.approx(seen[1], abs=1e-9 * left.max())
        assert seen[0] == pytest.approx(colours @ gamut.primaries.T, abs=1e-9 * left.max())
        # As bright as can be: white fills a channel of one of them.
        assert gamut.matrices.sum(axis=2).max() == pytest.approx(1)


def inside(triangle, points):
    barycentric = np.linalg.solve(
        np.vstack([triangle.T, np.ones(3)]), np.vstack([points.T, np.ones(len(points))])
    )
    return (barycentric >= 0).all(axis=0)


def area(triangles):
    (ax, ay), (bx, by) = np.moveaxis(triangles[:, 1:] - triangles[:, :1], 0, -1)
    return np.abs(ax * by - ay * bx) / 2


# Three primaries each; the colours that both show have 4, 5 and 6 corners.
@pytest.mark.parametrize("seed", [1, 10, 12])
def test_no_triangle_of_shared_colours_is_larger(seed: int):
    rng = np.random.default_rng(seed)
    other = RIGHT * rng.uniform(0.8, 1.25, (3, 3))
    gamut = common_gamut(LEFT, other)
    left, right = uv(LEFT.T), uv(other.T)
    points = rng.uniform(np.minimum(left.min(0), right.min(0)), left.max(0), (200_000, 2))
    points = points[inside(left, points) & inside(right, points)]
    hull = points[ConvexHull(points).vertices]
    triangles = hull[list(combinations(range(len(hull)), 3))]
    ours = float(area(uv(gamut.primaries.T)[None])[0])
    assert 0.98 * ours < area(triangles).max() <= ours


def test_no_white_between_the_projectors_own_is_brighter():
    gamut = common_gamut(LEFT, RIGHT)
    whites = np.stack([LEFT.sum(axis=1), RIGHT.sum(axis=1)], axis=1)
    mixed = np.random.default_rng(7).random((100_000, 2)) @ whites.T
    shown = np.concatenate([mixed @ np.linalg.inv(m).T for m in (LEFT, RIGHT)], axis=1)
    reached = mixed[(shown.min(axis=1) >= 0) & (shown.max(axis=1) <= 1)]
    assert 0.98 * gamut.white[1] < reached[:, 1].max() <= gamut.white[1] * (1 + 1e-9)


def test_equal_projectors_lose_nothing():
    gamut = common_gamut(LEFT, LEFT)
    assert gamut.matrices == pytest.approx(np.stack([np.eye(3)] * 2), abs=1e-9)
    assert gamut.lost == pytest.approx([0, 0], abs=1e-9)
    dimmer = common_gamut(LEFT, 0.6 * LEFT)
    assert dimmer.matrices == pytest.approx(np.stack([0.6 * np.eye(3), np.eye(3)]), abs=1e-9)
    assert dimmer.lost == pytest.approx([0.4, 0], abs=1e-9)


def test_a_white_may_be_asked_for():
    gamut = common_gamut(LEFT, RIGHT, white=(0.3127, 0.3290))
    assert gamut.chromaticities[3] == pytest.approx([0.3127, 0.3290])
    assert gamut.matrices.sum(axis=2).max() == pytest.approx(1)
    refused(lambda: common_gamut(LEFT, RIGHT, white=(0.7, 0.4)), "chromaticity", "(0.7, 0.4)")
    refused(lambda: common_gamut(LEFT, RIGHT, white=(0.05, 0.8)), "same white")
    with pytest.raises(ValueError, match="twice"):
        common_gamut(LEFT[0], LEFT[0])


def test_projectors_without_common_colours_are_refused():
    reds = np.array([[40.0, 41, 42], [20.0, 18, 16], [1.0, 2, 1.5]])
    blues = np.array([[15.0, 16, 17], [5.0, 6, 7], [80.0, 75, 82]])
    refused(lambda: common_gamut(reds, blues), "common gamut")


def test_crosstalk_in_common_light_shows_the_same_ghost(read):
    pair = measured_pair(read(Rig().csv()))
    other = np.array([0.3, 0.9, 0.5])
    for view, (own, leak) in enumerate([(LEFT, TO_LEFT), (RIGHT, TO_RIGHT)]):
        ghost = pair.gamut.primaries @ pair.common_matrices[view] @ other
        assert ghost == pytest.approx(own @ leak @ pair.gamut.matrices[1 - view] @ other, rel=1e-5)


# Response


def display_rows(curve, channels="RGB", levels=(*RAMP, 1.0), primaries=LEFT):
    black = BLACK["left"]
    rows = ["channel,level,X,Y,Z", "K,0," + ",".join(map(str, black))]
    for i, channel in enumerate(channels):
        for level in levels:
            xyz = primaries[:, i] * curve(level) + black
            rows.append(f"{channel},{level}," + ",".join(f"{v:.8g}" for v in xyz))
    return rows


def one(readings):
    return measured_display(readings.session("display", "none"))


def test_a_response_that_is_no_gamma_becomes_a_table(read):
    curve = lambda x: 3 * x**2 - 2 * x**3  # noqa: E731 - an S, as liquid crystals have
    levels = np.linspace(0.05, 1, 20)
    response = one(read("\n".join(display_rows(curve, levels=levels)))).response
    assert isinstance(response.transfer, MeasuredTable)
    assert response.misfit.max() > 1
    codes = np.tile(np.linspace(0, 1, 101)[:, None], 3)
    decoded = response.transfer.decode(codes)
    assert decoded == pytest.approx(curve(codes), abs=3e-3)
    assert response.transfer.encode(decoded) == pytest.approx(codes, abs=1e-9)


def test_primaries_of_unequal_gamma_become_a_table(read):
    rows = display_rows(lambda x: x**2.2, "RG")
    rows += [row for row in display_rows(lambda x: x**1.8) if row.startswith("B")]
    response = one(read("\n".join(rows))).response
    assert isinstance(response.transfer, MeasuredTable)
    assert response.exponents == pytest.approx([2.2, 2.2, 1.8], abs=1e-4)
    assert response.rms.max() < 1e-4


def test_a_dip_within_the_noise_is_levelled_and_told(read):
    levels = (0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.0)
    lift = {0.4: 1.03, 0.5: 0.97}
    rows = display_rows(
        lambda x: (0.2 + 0.1 * x if 0.3 < x < 0.6 else x**2.2) * lift.get(x, 1), levels=levels
    )
    response = one(read("\n".join(rows), noise=Noise(0.02))).response
    assert isinstance(response.transfer, MeasuredTable)
    assert [note[:1] for note in response.repaired] == ["R", "G", "B"]
    assert "from level 0.4 to 0.5, within the noise, was levelled" in response.repaired[0]
    refused(lambda: one(read("\n".join(rows), noise=Noise(0.001))), "line 7", "must rise")


def test_a_grey_ramp_stands_in_for_the_primaries(read):
    rows = display_rows(lambda x: x**2.5, levels=(1.0,))
    total = LEFT.sum(axis=1)
    for level in (*RAMP, 1.0):
        xyz = total * level**2.5 + BLACK["left"]
        rows.append(f"W,{level}," + ",".join(f"{v:.8g}" for v in xyz))
    display = one(read("\n".join(rows)))
    assert display.response.transfer.exponent == pytest.approx(2.5, abs=1e-4)
    assert any("ramp of W" in note for note in display.notes)


# Refusals

GOOD = Rig(ramps=False).csv().splitlines()


def with_chromaticities(lines, name, unit):
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        x, y, z = map(float, row[-3:])
        light = (y / unit, x / (x + y + z), y / (x + y + z))
        row[-3:] = [f"{value:.12g}" for value in light]
    return "\n".join([lines[0].replace("X,Y,Z", f"{name},x,y"), *map(",".join, rows)])


@pytest.mark.parametrize(("name", "unit"), [("Y", 1), ("Lv", 1), ("fL", 3.4262591)])
def test_luminance_and_chromaticity_are_light(read, name, unit):
    """A foot-lambert is 3.426259 cd/m² (NIST SP 811, B.8)."""
    found = read(with_chromaticities(GOOD, name, unit)).rows
    wanted = read("\n".join(GOOD)).rows
    assert np.allclose([row.xyz for row in found], [row.xyz for row in wanted], rtol=1e-7)


def decimal_commas(lines):
    """As Excel writes them where a comma is the decimal point."""
    cells = [[f'"{cell.replace(".", ",")}"' for cell in line.split(",")] for line in lines[1:]]
    return [lines[0], *map(",".join, cells)]


def test_a_line_that_tells_excel_the_separator_is_no_row(read):
    plain, told = (
        one(read("\n".join(rows)))
        for rows in (display_rows(lambda x: x**2.2), ["sep=,", *display_rows(lambda x: x**2.2)])
    )
    assert told.response.transfer.exponent == plain.response.transfer.exponent
    refused(lambda: read("sep=,"), "rig.csv", "'sep=' alone")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda t: [t[0].replace(",X", ",x"), *t[1:]], ["line 1: column X is missing", "mean X?"]),
        (lambda t: [t[0].replace("filter,", "eyes,"), *t[1:]], ["column filter is missing"]),
        (lambda t: [t[0].replace(",Z", ",Y"), *t[1:]], ["'Y' is there 2 times", "Z is missing"]),
        (lambda t: [x.replace(",", ";") for x in t], ["line 1: cells must be separated by commas"]),
        (decimal_commas, ["numbers have a decimal point, got '"]),
        (lambda t: [t[0].replace("X,Y,Z", "Lv,x,y"), *t[1:]], ["x must be 0 to 1, got"]),
        (lambda t: [t[0].replace("X,Y,Z", "X,x,y"), *t[1:]], ["column 'X' is not known", "Y is m"]),
        (lambda t: [t[0].replace("X,Y,Z", "Lv,x,y"), "left,left,K,0,.1,.3,0"], ["those of white"]),
        (lambda t: [t[0], t[1].replace(".", ","), *t[2:]], ["line 2: must have 7 cells", "comma"]),
        (lambda t: [*t, "left,left,Q,1,1,1,1"], ["channel must be R, G, B, W or K, got 'Q'"]),
        (lambda t: [*t, "up,left,R,1,1,1,1"], ["projector must be left or right, got 'up'"]),
        (lambda t: [*t, "left,both,R,1,1,1,1"], ["filter must be left, right or none"]),
        (lambda t: [*t, "left,left,R,255,1,1,1"], ["level must be 0 to 1, got 255; divide codes"]),
        (lambda t: [*t, "left,left,K,1,1,1,1"], ["level of K must be 0, got 1"]),
        (lambda t: [*t, "left,left,R,0.5,nan,1,1"], ["X must be a number, got 'nan'"]),
        (lambda t: [*t, "left,left,R,0.5,inf,1,1"], ["X must be a number, got 'inf'"]),
        (lambda t: [*t, "left,left,R,0.5,,1,1"], ["X must be a number, got nothing"]),
        (lambda t: [*t, "left,left,R,0.5,1,-1,1"], ["Y must be 0 to 1e+06, got -1; the unit"]),
        (lambda t: [*t, "left,left,W,1,9,9,9"], ["W at level 1 must repeat line 3"]),
        (lambda t: t[:1], ["wanted rows of readings"]),
        (lambda t: [], ["got nothing"]),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_its_line(read, change, expected):
    text = "\n".join(change(GOOD))
    message = refused(lambda: read(text), "rig.csv", *expected)
    if change(GOOD)[: len(GOOD)] == GOOD:
        assert f"line {len(GOOD) + 1}: " in message


def test_all_mistakes_are_told_at_once_in_the_order_of_their_lines(read):
    rows = ["# a comment", GOOD[0], "", "left,left,Q,2,x,-1,1", GOOD[1], "right,left,R,1,1,1,NaN"]
    message = refused(lambda: read("\n".join(rows)), "has 5 mistakes")
    told = [
        re.match(r"line (\d+): (\w+)", line.strip()).groups() for line in message.splitlines()[1:]
    ]
    assert told == [("4", "X"), ("4", "Y"), ("4", "channel"), ("4", "level"), ("6", "Z")]


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("rig.xlsx", b"PK", ".csv, .toml or .ti3, got '.xlsx'"),
        ("rig.csv", b"\xff\xfe\x00", "UTF-8"),
        ("rig.toml", b"a = ", "not valid TOML"),
        ("rig.toml", b"a = 1", "[[reading]]"),
        ("rig.csv", None, "No such file"),
    ],
)
def test_a_file_that_is_no_table_is_refused(tmp_path, name, content, expected):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    refused(lambda: read_readings(tmp_path / name), name, expected)


def without(text, *starts):
    return "\n".join(row for row in text.splitlines() if not row.startswith(starts))


def test_white_that_is_not_the_sum_is_refused(read):
    def boosted(share):
        return measured_pair(read(Rig(ramps=False, white=share).csv(), noise=Noise(0.005)))

    assert boosted(1.01).displays[0].additivity == pytest.approx(0.01 / 1.01, rel=1e-3)
    assert not any("additivity" in note for note in boosted(1.01).displays[0].notes)
    notes = boosted(1.05).displays[0].notes
    assert any("misses W by more than 2%" in note and "Y +4.8%" in note for note in notes)
    refused(
        lambda: boosted(1.15),
        "line 3: left projector through left filter: W must be R + G + B",
        "Y +13.0%",
        "white boost",
    )


def test_negative_entries_are_zeroed_kept_or_refused(read):
    negative = TO_LEFT.copy()
    negative[0, 1] = -0.004
    text = Rig(ramps=False, to_left=negative).csv()
    sure, unsure = Noise(1e-3, 1e-4), Noise(0.05, 0.01)
    refused(
        lambda: measured_pair(read(text, noise=sure)),
        "the left eye",
        "-0.400%",
        "(own R of the other's G)",
        "allow negative",
    )
    kept = measured_pair(read(text, noise=sure), allow_negative=True).crosstalk[0]
    assert kept.matrix[0, 1] == pytest.approx(-0.004, abs=1e-6)
    assert any("were kept" in note for note in kept.notes)
    zeroed = measured_pair(read(text, noise=unsure)).crosstalk[0]
    assert zeroed.matrix[0, 1] == 0
    assert zeroed.measured[0, 1] == pytest.approx(-0.004, abs=1e-6)
    assert any(note.startswith("entry R G: -0.400%") for note in zeroed.notes)


def exchanged(text):
    swap = {"left": "right", "right": "left"}
    rows = [row.split(",") for row in text.splitlines()[1:]]
    return "\n".join([GOOD[0], *(",".join([a, swap[b], *rest]) for a, b, *rest in rows)])


def of_woods(*leaks):
    """Another leak of each colour, in the order of `WOODS`."""
    text = WOODS
    for before, after in zip(("0.54", "0.62", "0.52", "0.68", "0,0.5,0\n"), leaks, strict=True):
        text = text[: text.index("right")] + text[text.index("right") :].replace(before, after)
    return text


PAIR = "\n".join(GOOD)
COLOURS = "channel,X,Y,Z\nR,20,10,1\nG,{}\nB,8,3,40\nW,{}\nK,0.1,0.1,0.1"
BAD = {
    "no session": (measured_pair, without(PAIR, "right,left"), "right projector through left filt"),
    "no black": (measured_pair, without(PAIR, "left,left,K"), "left filter: no reading of K"),
    "no green": (measured_pair, without(PAIR, "right,left,G"), "no reading of G at level 1"),
    "exchanged": (measured_pair, exchanged(PAIR), "filters or the projectors exchanged"),
    "darker": (leak_of, of_woods("0.44", "0.42", "0.46", "0.3", "0,0.45,0\n"), "darker than black"),
    "no white": (one, COLOURS.format("10,25,0.5", "0.1,0.1,0.1"), "W must be brighter than black"),
    "one colour": (one, COLOURS.format("10.05,5.05,0.55", "38,18,42"), "must be different colours"),
    "black": (one, COLOURS.format("0.1,0.1,0.1", "38,18,42"), "G must be brighter than black"),
    "no ramp": (
        one,
        "\n".join(display_rows(lambda x: 0.97 + 0.03 * x)),
        "line 3: display: R at level 0.1 must be well below",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_readings_that_cannot_be_are_refused(read, case):
    measured, text, word = BAD[case]
    refused(lambda: measured(read(text)), word)


FINE = display_rows(lambda x: x**2.2, levels=np.linspace(1 / 30, 1, 30))
FINE[1] = "K,0,0.001,0.001,0.001"


def with_light_of(line, other):
    changed = list(FINE)
    changed[line - 1] = ",".join([*FINE[line - 1].split(",")[:2], *FINE[other - 1].split(",")[2:]])
    return changed


def in_foot_lamberts(*lines):
    changed = list(FINE)
    for line in lines:
        channel, level, *xyz = FINE[line - 1].split(",")
        changed[line - 1] = ",".join([channel, level, *(f"{float(v) / 3.426:g}" for v in xyz)])
    return changed


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (with_light_of(19, 25), "line 20: display: light must rise with level"),
        (with_light_of(19, 49), "line 19: display: R at level 0.566667 must have the colour of"),
        (in_foot_lamberts(19), "line 19: display: light must rise with level"),
        (in_foot_lamberts(*range(4, 19)), "light must rise smoothly"),
    ],
    ids=["exchanged", "another channel", "a row in foot-lamberts", "half in foot-lamberts"],
)
def test_a_row_that_does_not_fit_its_neighbours_is_refused(read, rows, expected):
    refused(lambda: one(read("\n".join(rows))), expected)


def test_a_ramp_of_white_without_full_white_is_no_response(read):
    rows = display_rows(lambda x: x**2.5, levels=(1.0,))
    rows += [f"W,{x},{40 * x**2.5 + 1},{40 * x**2.5 + 1},{40 * x**2.5 + 1}" for x in RAMP]
    assert one(read("\n".join(rows))).response is None


def test_whatever_is_wrong_is_told_as_such(read):
    """Cells changed at random give a result or an InputError, and nothing else."""
    rng = np.random.default_rng(8)
    junk = ["", "-3", "0", "1e400", "1e-300", "nan", "K", "left", "99", "0,5", "R", '"', "1e5", "W"]
    rows = Rig(noise=NOISE).csv().splitlines()
    refusals = 0
    for _ in range(150):
        changed = list(rows)
        for line in rng.integers(len(rows), size=rng.integers(1, 3)):
            cells = changed[line].split(",")
            cells[rng.integers(len(cells))] = junk[rng.integers(len(junk))]
            changed[line] = ",".join(cells)
        try:
            measured_pair(read("\n".join(changed), noise=NOISE))
        except InputError:
            refusals += 1
    assert 75 < refusals < 150


# The real table: a CRT, 30 levels a gun, black in a row but subtracted elsewhere, no white


@real
def test_the_crt_table_as_it_is_says_that_black_is_gone_already():
    readings = read_readings(CRT)
    refused(
        lambda: one(readings),
        "line 4: display: R at level 0.033333 must not be darker than",
        "line 94",
        "60 more",
        "black: subtracted",
    )


@real
def test_the_crt_table_gives_a_sensible_display():
    display = one(read_readings(CRT, black="subtracted"))
    response = display.response
    # Near black a CRT's offset makes a pure power wrong: the table is kept.
    assert isinstance(response.transfer, MeasuredTable)
    assert response.exponents == pytest.approx([1.75, 1.67, 1.75], abs=0.02)
    assert response.rms.max() < 0.01
    assert display.additivity is None
    assert any("no reading of W" in note for note in display.notes)
    assert display.white == pytest.approx([135.744, 142.701, 203.158], rel=1e-4)
    assert display.contrast == pytest.approx(26.6, abs=0.1)
    # Rec. 709-like phosphors
    assert display.chromaticities[:3] == pytest.approx(
        np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]]), abs=0.02
    )
    assert 0 < display.drift.max() < 0.01
    codes = np.tile(np.linspace(0, 1, 256)[:, None], 3)
    assert response.transfer.encode(response.transfer.decode(codes)) == pytest.approx(codes)
