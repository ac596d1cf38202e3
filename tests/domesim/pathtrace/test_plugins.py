"""The domemaster camera and the fisheye projector, against geometry and photometry by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.plugins import register
from domesim.room.dome import Dome

ALBEDO = 0.4


@pytest.fixture(scope="module")
def mi() -> Any:
    mitsuba = load_mitsuba()
    register(mitsuba)
    register(mitsuba)  # a second time changes nothing
    return mitsuba


def camera(mi: Any, size: int = 9, **settings: Any) -> Any:
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    return mi.load_dict({"type": "domemaster", "film": film, **settings})


def rays_of(mi: Any, sensor: Any, across: Any, down: Any) -> tuple[NDArray[Any], ...]:
    """Origins and directions (..., xyz) and weights at places 0..1 of the picture."""
    across, down = np.broadcast_arrays(np.float32(across), np.float32(down))
    place = mi.Point2f(across.ravel(), down.ravel())
    ray, weight = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    shape = across.shape
    vectors = [np.array(part).T.reshape(*shape, 3) for part in (ray.o + 0 * ray.d, ray.d)]
    return *vectors, np.array(weight + 0 * ray.d.x)[0].reshape(shape)


def pixel_centres(size: int) -> list[NDArray[np.float64]]:
    centres = (np.arange(size) + 0.5) / size
    return list(np.meshgrid(centres, centres))


@pytest.mark.parametrize("half_angle", [np.pi / 2, 1.1, 2.4])
def test_camera_looks_where_the_dome_says(mi: Any, half_angle: float) -> None:
    dome = Dome(radius=1.0, half_angle=half_angle)
    _, toward, weight = rays_of(mi, camera(mi, half_angle=half_angle), *pixel_centres(9))
    inside = dome.inside(9, 9)
    assert not inside.all()
    np.testing.assert_allclose(toward[inside], dome.directions(9, 9)[inside], atol=2e-6)
    np.testing.assert_array_equal(weight > 0, inside)


def test_eyes_are_level_beside_the_direction_looked_in(mi: Any) -> None:
    left, right = (camera(mi, eye_offset=side * 0.03) for side in (-1, 1))
    # Looking to the front, to the right, and to the front 30 degrees from the zenith.
    across, down = [0.5, 1.0, 0.5], [1.0, 0.5, 0.5 + 1 / 6]
    beside = np.array([[0.03, 0, 0], [0, -0.03, 0], [0.015, 0, 0]])
    for sensor, wanted in ((right, beside), (left, -beside)):
        origin, toward, _ = rays_of(mi, sensor, across, down)
        np.testing.assert_allclose(origin, wanted, atol=1e-8)
        np.testing.assert_allclose(toward[2], [0, 0.5, np.sqrt(0.75)], atol=1e-6)


def test_camera_can_be_turned_and_moved(mi: Any) -> None:
    aimed = mi.ScalarTransform4f().look_at([1, 2, 3], [1, 12, 3], [0, 0, -1])
    origin, toward, _ = rays_of(mi, camera(mi, to_world=aimed), 0.5, 0.5)
    np.testing.assert_allclose(origin, [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(toward, [0, 1, 0], atol=1e-6)


def test_camera_crops(mi: Any) -> None:
    film = {"type": "hdrfilm", "width": 9, "height": 9, "rfilter": {"type": "box"},
            "crop_offset_x": 2, "crop_offset_y": 4, "crop_width": 3, "crop_height": 5}  # fmt: skip
    across, down = np.meshgrid((np.arange(3) + 0.5) / 3, (np.arange(5) + 0.5) / 5)
    _, toward, _ = rays_of(mi, mi.load_dict({"type": "domemaster", "film": film}), across, down)
    whole = Dome(radius=1.0, half_angle=np.pi / 2).directions(9, 9)
    np.testing.assert_allclose(toward, whole[4:9, 2:5], atol=1e-6)


def test_both_eyes_meet_at_the_convergence(mi: Any) -> None:
    dome = Dome(radius=4.0, half_angle=np.pi / 2)
    for offset in (-0.03, 0.03):
        sensor = camera(mi, eye_offset=offset, convergence=4.0)
        origin, toward, _ = rays_of(mi, sensor, *pixel_centres(9))
        aim = 4.0 * dome.directions(9, 9) - origin
        aim /= np.linalg.norm(aim, axis=-1, keepdims=True)
        assert np.abs(aim - dome.directions(9, 9)).max() > 1e-3
        np.testing.assert_allclose(toward[dome.inside(9, 9)], aim[dome.inside(9, 9)], atol=1e-6)


def projector(mi: Any, picture: NDArray[Any], **settings: Any) -> dict[str, Any]:
    bitmap = mi.Bitmap(picture.astype(np.float32))
    return {"type": "fisheye_projector", "bitmap": bitmap, **settings}


def matt(albedo: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}


def seen(mi: Any, scene: Any, integrator: dict[str, Any], origin: Any, toward: Any) -> Any:
    """Radiance (ray, rgb) along rays."""
    toward = np.asarray(toward, np.float32)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(5, len(toward))
    ray = mi.RayDifferential3f(o=mi.Point3f(*map(float, origin)), d=mi.Vector3f(*toward.T))
    radiance, _, _ = mi.load_dict(integrator).sample(scene, sampler, ray)
    return np.array(radiance).T.astype(np.float64)


def test_irradiance_falls_with_the_square_of_distance_and_the_cosine(mi: Any) -> None:
    """On a plane h below the lens E = I cos / d² = I h / (h² + x²)^(3/2), and L = albedo E / pi."""
    intensity, height = np.array([1.0, 2.0, 3.0]), 1.5
    scene = mi.load_dict(
        {
            "type": "scene",
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(50),
                "bsdf": matt(ALBEDO),
            },
            "lens": projector(
                mi,
                np.broadcast_to(intensity, (4, 4, 3)),
                to_world=mi.ScalarTransform4f().look_at([0, 0, height], [0, 0, 0], [0, 1, 0]),
            ),
        }
    )
    x = np.array([0.0, 0.5, 1.0, 3.0, 6.0])
    toward = np.stack([x, 0 * x, 0 * x - height], -1)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    radiance = seen(mi, scene, {"type": "direct"}, [0, 0, height], toward)
    irradiance = intensity * height / (height**2 + x[:, None] ** 2) ** 1.5
    np.testing.assert_allclose(radiance, ALBEDO * irradiance / np.pi, rtol=1e-3)


def inside_a_sphere(mi: Any, radius: float, lens: dict[str, Any]) -> Any:
    ball = {"type": "sphere", "radius": radius, "flip_normals": True, "bsdf": matt(ALBEDO)}
    return mi.load_dict({"type": "scene", "ball": ball, "lens": lens})


def evenly_spread(count: int) -> NDArray[np.float64]:
    """Unit vectors of a Fibonacci lattice."""
    index = np.arange(count) + 0.5
    z, azimuth = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], -1)


def test_all_light_of_the_field_and_no_more_arrives_on_a_sphere(mi: Any) -> None:
    """Off its centre as well: E integrated over the sphere is v times the field's solid angle."""
    half_angle, value, radius = 1.2, 0.7, 3.0
    place = mi.ScalarTransform4f().translate([0.8, -0.3, 0.5]).rotate([1, 0, 0], 40)
    lens = projector(mi, np.full((4, 4, 3), value), half_angle=half_angle, to_world=place)
    scene = inside_a_sphere(mi, radius, lens)
    radiance = seen(mi, scene, {"type": "direct"}, [0, 0, 0], evenly_spread(400_000))
    flux = radiance.mean() * np.pi / ALBEDO * 4 * np.pi * radius**2
    assert flux == pytest.approx(value * 2 * np.pi * (1 - np.cos(half_angle)), rel=1e-3)


def test_the_picture_is_neither_mirrored_nor_turned(mi: Any) -> None:
    size, radius, half_angle = 9, 2.0, 1.3
    picture = np.random.default_rng(1).uniform(0.1, 1.0, (size, size, 3))
    dome = Dome(radius=radius, half_angle=half_angle)
    inside = dome.inside(size, size)
    for filter_type in ("nearest", "bilinear"):
        lens = projector(mi, picture, half_angle=half_angle, filter_type=filter_type)
        scene = inside_a_sphere(mi, radius, lens)
        toward = dome.directions(size, size)[inside]
        radiance = seen(mi, scene, {"type": "direct"}, [0, 0, 0], toward)
        expected = ALBEDO / np.pi * picture[inside] / radius**2
        np.testing.assert_allclose(radiance, expected, rtol=1e-3)


def test_its_light_is_the_same_however_asked_for(mi: Any) -> None:
    """Differentiable integrators sample a direction first, and ask for the light again later."""
    scene = inside_a_sphere(
        mi, 2.0, projector(mi, np.random.default_rng(2).uniform(size=(9, 9, 3)))
    )
    ray = mi.Ray3f(o=mi.Point3f(0.0), d=mi.Vector3f(*evenly_spread(50).astype(np.float32).T))
    surface = scene.ray_intersect(ray)
    ds, sampled = scene.sample_emitter_direction(surface, mi.Point2f(0.5))
    again = scene.eval_emitter_direction(surface, ds)
    assert np.array(sampled).max() > 0.1
    np.testing.assert_allclose(np.array(again), np.array(sampled), rtol=1e-6)


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"half_angle": 4.0}, "half_angle"), ({"eye_offset": 0.1, "convergence": 0.1}, "convergence")],
)
def test_settings_that_cannot_be_are_refused(
    mi: Any, settings: dict[str, float], words: str
) -> None:
    with pytest.raises(Exception, match=words):
        camera(mi, **settings)


def test_lights_in_front_and_on_the_right_are_below_and_on_the_right(mi: Any) -> None:
    theta = np.pi / 2 * 10 / 21  # five of 21 pixels from the middle

    def ball(right: float, front: float, colour: list[float]) -> dict[str, Any]:
        light = {"type": "area", "radiance": {"type": "rgb", "value": colour}}
        centre = 5 * np.array([right * np.sin(theta), front * np.sin(theta), np.cos(theta)])
        return {"type": "sphere", "center": centre.tolist(), "radius": 0.6, "light": light}

    film = {"type": "hdrfilm", "width": 21, "height": 21, "rfilter": {"type": "box"}}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path"},
            "front": ball(0.0, 1.0, [1.0, 0.0, 0.0]),
            "right": ball(1.0, 0.0, [0.0, 1.0, 0.0]),
            "sensor": {"type": "domemaster", "film": film},
        }
    )
    picture = np.array(mi.render(scene, spp=16, seed=3))
    for channel, place in ((0, (15, 10)), (1, (10, 15))):
        row, col = np.unravel_index(picture[..., channel].argmax(), (21, 21))
        assert (row, col) == place
        assert picture[row, col, channel] == pytest.approx(1.0)


def test_filters_differ_between_pixels(mi: Any) -> None:
    """Half way between the centres of two pixels and a little: 0.3 and 0.7 of the way."""
    picture = np.zeros((2, 2, 3))
    picture[:, 1] = 1.0
    theta = 0.2 * np.pi / 2  # u = 0.2, which is 0.7 of the way from -0.5 to 0.5
    toward = np.array([[np.sin(theta), 0.0, np.cos(theta)]])
    for filter_type, value in (("nearest", 1.0), ("bilinear", 0.7)):
        scene = inside_a_sphere(mi, 1.0, projector(mi, picture, filter_type=filter_type))
        radiance = seen(mi, scene, {"type": "direct"}, [0, 0, 0], toward)
        np.testing.assert_allclose(radiance, value * ALBEDO / np.pi, rtol=1e-3)


def test_path_integrator_is_unbiased_by_it(mi: Any) -> None:
    """In a whole sphere the reflected light is known: E = v / r² + albedo/(1 - albedo) v / r²."""
    value, radius, batches = 0.9, 2.0, 40
    lens = projector(mi, np.full((4, 4, 3), value), half_angle=np.pi)
    scene = inside_a_sphere(mi, radius, lens)
    path = {"type": "path", "max_depth": 40, "rr_depth": 3}
    radiance = seen(mi, scene, path, [0.2, 0.1, 0.3], evenly_spread(80_000)[:, [2, 0, 1]])
    means = radiance[:, 0].reshape(-1, batches).mean(axis=0)
    truth = ALBEDO / np.pi * value / radius**2 / (1 - ALBEDO)
    error = means.std(ddof=1) / np.sqrt(batches)
    assert error < 2e-3 * truth
    assert abs(means.mean() - truth) < 4 * error


def test_sampled_rays_carry_the_flux(mi: Any) -> None:
    half_angle, value = 1.1, 0.6
    lens = mi.load_dict(projector(mi, np.full((4, 4, 3), value), half_angle=half_angle))
    u, v = pixel_centres(64)
    ray, weight = lens.sample_ray(0.0, 0.5, mi.Point2f(0.5), mi.Point2f(u.ravel(), v.ravel()))
    flux = value * 2 * np.pi * (1 - np.cos(half_angle))
    assert np.array(weight).mean() == pytest.approx(flux, rel=1e-5)
    assert np.array(ray.d.z).min() == pytest.approx(np.cos(half_angle), abs=0.02)
