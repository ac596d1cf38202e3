"""Subcommands that trace paths: ``render`` and ``tabulate``."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from domesim.commands import INTERRUPTED
from domesim.commands.options import Json, Overwrite, Quiet, Repair, finish
from domesim.errors import InputError
from domesim.frames import read_master
from domesim.host.console import Console, about
from domesim.host.numbers import decimal, percent
from domesim.host.writing import prepare
from domesim.inspection.coverage import require_covered
from domesim.inspection.magnitudes import SOURCES, Faintest, sky_brightness, video_star
from domesim.observation.stereo import VIEWS
from domesim.scene import CinemaScene, DomeScene, StereoScene, load_dome, load_scene
from domesim.scene.crosstalk_maps import CrosstalkMaps
from domesim.scene.screening import decoded
from domesim.scene.stereo import MAP_CELLS

if TYPE_CHECKING:
    from domesim.pathtrace.tabulate import Tabulation
    from domesim.pathtrace.tracer import Settings, Traced

_PREVIEW = 2048
"""Most pixels a side of a preview."""

_ERROR, _WALKS, _DEGREE = 5e-4, 2e8, 6
"""How a dome is tabulated if nobody asks for more."""

SceneArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENE", help="The theatre: its name, or the path of a .toml file.",
        show_default=False,
    ),
]  # fmt: skip
RenderedMasters = Annotated[
    list[Path] | None,
    typer.Option(
        "--master",
        help="The domemaster on the screen; of a 3D dome twice: left, then right. The bundled "
        "night scene if none.",
        show_default=False,
    ),
]
View = Annotated[
    str,
    typer.Option(
        help="domemaster, seat:NAME (a viewpoint of the scene, such as seat:centre), or cutaway "
        "(the theatre itself, from outside; a .png file)."
    ),
]
OutFile = Annotated[Path, typer.Option("--out", help="File to write.", show_default=False)]
Error = Annotated[
    float,
    typer.Option(
        help="Standard error to reach: rms over the pixels, relative to the mean reflected light."
    ),
]
Most = Annotated[int, typer.Option("--samples", help="Most paths a pixel.")]
Seed = Annotated[int, typer.Option(help="Seed of the random numbers.")]
PerBounce = Annotated[bool, typer.Option("--per-bounce", help="Write a layer for each bounce.")]
Size = Annotated[
    int | None,
    typer.Option(help="Pixels a side of the domemaster, or the width of another view."),
]


def render(
    scene: SceneArgument,
    out: OutFile,
    master: RenderedMasters = None,
    view: View = "domemaster",
    size: Size = None,
    error: Error = 0.05,
    samples: Most = 1 << 14,
    seed: Seed = 0,
    per_bounce: PerBounce = False,
    repair: Repair = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Path-trace what is seen in a theatre: layers of direct and reflected light in cd/m²."""
    console = Console(quiet=quiet, json=json)
    theatre = load_dome(scene)
    if view != "cutaway":
        require_covered(theatre, scene)
    if size is not None and not 2 <= size <= 16384:
        raise InputError(f"--size must lie in 2..16384, got {size}")
    if samples < 2:
        raise InputError(f"--samples must be at least 2, for an error to be known, got {samples}")
    _require_seed(seed)
    suffix = ".png" if view == "cutaway" else ".exr"
    if out.suffix.lower() != suffix:
        raise InputError(f"--out {out}: the view {view!r} is written as {suffix}, name it so")
    outs = _outputs(theatre, view, out)
    masters = _masters(theatre, master)
    written = dict.fromkeys(path.with_suffix(end) for path in outs for end in (path.suffix, ".png"))
    prepare(*written, inputs=[scene, *masters], overwrite=overwrite)
    pictures = [
        _picture(theatre.one_eye, path, size if view == "domemaster" else None, repair, console)
        for path in dict.fromkeys(masters)
    ]
    if len({picture.shape for picture in pictures}) > 1:
        sizes = " and ".join(f"{len(picture)}" for picture in pictures)
        raise InputError(f"--master: left and right must be of one size, got {sizes}; give --size")
    if view == "cutaway":
        _cutaway(theatre, pictures[0], out, size or 1200, console)
        return
    # Slow to import, and not needed for --help
    from domesim.pathtrace.llvm import told as traced_by  # noqa: PLC0415
    from domesim.pathtrace.tracer import Settings, Status  # noqa: PLC0415

    settings = Settings(error=error, most=samples, least=min(32, samples), seed=seed,
                        per_bounce=per_bounce)  # fmt: skip
    console.say(traced_by())
    traced = _traced(theatre, pictures, view, size, settings, console)
    told = [
        _write(theatre, view, layers, facts, path, console)
        for (layers, facts), path in zip(traced, outs, strict=True)
    ]
    _finish(
        console,
        told[0] if len(told) == 1 else dict(zip(VIEWS, told, strict=True)),
        any(figures["status"] == Status.INTERRUPTED.value for figures in told),
    )


def _traced(
    scene: DomeScene,
    pictures: Sequence[NDArray[np.float32]],
    view: str,
    size: int | None,
    settings: Settings,
    console: Console,
) -> list[tuple[dict[str, NDArray[Any]], dict[str, Any]]]:
    """Layers and facts of what is seen, of a 3D dome by each eye."""
    from domesim.pathtrace.tracer import Status  # noqa: PLC0415

    eyes = scene.stereo
    if eyes is not None and eyes.kept not in (0, 1):
        settings = replace(settings, per_bounce=True)
    traced: list[tuple[dict[str, NDArray[Any]], dict[str, Any]]] = []
    for eye, picture in enumerate(pictures):
        settings = replace(settings, seed=settings.seed + eye)
        if traced and traced[0][1]["status"] == Status.INTERRUPTED.value:
            settings = replace(settings, most=settings.least)
        if view == "domemaster":
            traced.append(_domemaster(scene, picture, settings, console))
        else:
            traced.append(_from_seat(scene, picture, view, size or 960, settings, console))
    each = [layers for layers, _ in traced]
    if eyes is not None:
        from domesim.pathtrace.two_eyes import seen_by_eyes  # noqa: PLC0415

        each = seen_by_eyes((each[0], each[-1]), eyes.kept, eyes.leaks)
    if view == "domemaster":
        for layers in each:
            layers[""] += scene.black_frame(*layers[""].shape[:2])
    facts = _of_all([facts for _, facts in traced])
    return [(layers, facts) for layers in each]


def _of_all(facts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a picture that holds the light of all traced ones."""
    return {
        **facts[0],
        "status": _worst(each["status"] for each in facts),
        "relative_error": max(each["relative_error"] for each in facts),
        "samples": min(each["samples"] for each in facts),
        **{name: sum(each[name] for each in facts) for name in ("segments", "cpu_s")},
    }


def _outputs(scene: DomeScene, view: str, out: Path) -> list[Path]:
    """Files to write: of a 3D dome one for each eye, named as masters are."""
    if scene.stereo is None or view == "cutaway":
        return [out]
    return [out.with_name(f"{out.stem}_{eye}{out.suffix}") for eye in "LR"]


def _masters(scene: DomeScene, paths: Sequence[Path] | None) -> list[Path]:
    """One master a view."""
    if not paths:
        bundled = Path(str(resources.files("scenes").joinpath("masters", "night.exr")))
        return [bundled] * scene.views
    if len(paths) != scene.views:
        raise InputError(
            f"--master: wanted {'one domemaster' if scene.views == 1 else 'left, then right'} for "
            f"{scene.name}, got {len(paths)}: --master {' --master '.join(map(str, paths))}"
        )
    return list(paths)


def tabulate(
    scene: SceneArgument,
    out: OutFile,
    error: Annotated[
        float,
        typer.Option(
            help="Domes: rms standard error to reach, relative to the mean reflected light."
        ),
    ] = _ERROR,
    walks: Annotated[float, typer.Option(help="Domes: most paths.")] = _WALKS,
    degree: Annotated[
        int, typer.Option(help="Domes: degree of the smooth patterns that carry the light, 0..12.")
    ] = _DEGREE,
    seed: Seed = 0,
    check: Annotated[
        bool, typer.Option(help="Domes: compare with the radiosity model where it applies.")
    ] = True,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Trace a dome's reflected light, or a polarised 3D cinema's crosstalk, for --transport."""
    console = Console(quiet=quiet, json=json)
    theatre = load_scene(scene)
    if isinstance(theatre, CinemaScene):
        raise InputError(
            f"{scene}: a 2-D cinema's light is computed from its scene file; nothing is tabulated"
        )
    if out.suffix != ".npz":
        raise InputError(f"--out {out}: a transport is stored as .npz, name it so")
    if not walks >= 1:
        raise InputError(f"--walks must be at least 1, got {walks:g}")
    _require_seed(seed)
    if isinstance(theatre, StereoScene):
        _require_no_dome_options(theatre, error, walks, degree, check=check)
    prepare(out, inputs=[scene], overwrite=overwrite)
    from domesim.pathtrace.llvm import told as traced_by  # noqa: PLC0415

    if isinstance(theatre, StereoScene):
        _tabulate_crosstalk(theatre, scene, out, seed, console)
        return
    assert isinstance(theatre, DomeScene)
    require_covered(theatre, scene)
    from domesim.pathtrace.tabulate import tabulate as traced  # noqa: PLC0415
    from domesim.pathtrace.tracer import Status  # noqa: PLC0415

    console.say(traced_by())
    provenance = {"scene": theatre.name, "digest": theatre.digest}
    with console.share("tabulating") as progress:
        tabulation = traced(
            theatre.theatre,
            error=error,
            most=walks,
            degree=degree,
            seed=seed,
            provenance=provenance,
            progress=progress,
        )
    tabulation.transport.save(out)
    gain = tabulation.transport.mean_gain()
    closed = _closed_gain(theatre)
    figures: dict[str, Any] = {
        "scene": theatre.name,
        "output": str(out),
        "status": tabulation.status.value,
        "walks": tabulation.walks,
        "cpu_s": tabulation.seconds,
        "relative_error": tabulation.transport.relative_error(),
        "mean_gain": gain.tolist(),
        "closed_form_gain": closed.tolist(),
        "rank": tabulation.transport.rank,
        "reduced_rank": tabulation.transport.reduced(1e-3).rank,
    }
    console.say(
        f"{theatre.name}: a white picture's reflected light is {_per_primary(gain)} of its direct "
        f"light (closed form of the bare screen: {_per_primary(closed)})",
        f"standard error {percent(figures['relative_error'])} of it {_after(tabulation.walks)}, "
        f"{decimal(tabulation.seconds, 2)} CPU-s. {tabulation.status.value}",
    )
    interrupted = tabulation.status is Status.INTERRUPTED
    if check and not interrupted:
        figures["second_opinion"] = _second_opinion(theatre, tabulation, console)
    console.say(
        f"  -> {out}", f"Use it: domesim compensate MASTER --scene {scene} --transport {out}"
    )
    _finish(console, figures, interrupted)


def _require_no_dome_options(
    scene: StereoScene, error: float, walks: float, degree: int, *, check: bool
) -> None:
    changed = {
        "--error": error != _ERROR,
        "--walks": walks != _WALKS,
        "--degree": degree != _DEGREE,
        "--no-check": not check,
    }
    named = " and ".join(option for option, is_given in changed.items() if is_given)
    if named:
        raise InputError(f"{named}: for domes, {scene.name} is a stereo system; leave it out")


def _tabulate_crosstalk(
    scene: StereoScene, name: str, out: Path, seed: int, console: Console
) -> None:
    """Store the crosstalk maps of all seats, and say how far the estimate by hand was off."""
    from domesim.pathtrace.polarised import luminance_map  # noqa: PLC0415

    if scene.theatre is None:
        raise InputError(
            f"{scene.name}: wanted hardware to trace light through ([crosstalk.polarisation]), got "
            f"crosstalk as {scene.model}. It is used as it is: leave --transport out"
        )
    maps, rows = [], []
    with console.share("tracing") as progress:
        for before, seat in enumerate(scene.seats):

            def report(done: float, before: int = before, seat: str = seat) -> None:
                progress((before + done) / len(scene.seats), seat)

            weights = scene.projector.luminance_weights
            traced = luminance_map(
                scene.theatre, weights, seat, *MAP_CELLS, seed=seed, progress=report
            )
            maps.append(traced)
            estimate = scene.seats[seat].share
            assert estimate is not None
            middle = tuple(cells // 2 for cells in MAP_CELLS)
            figures = {
                "mean": float(traced.share.mean()),
                "middle": float(traced.share[(0, *middle)]),
                "middle_standard_error": float(traced.standard_error[(0, *middle)]),
                "largest": float(traced.share.max()),
                "off_the_estimate": float(np.max(np.abs(traced.share / estimate - 1))),
            }
            rows.append({"seat": seat, **figures})
            console.say(
                f"{seat}: crosstalk {figures['mean']:.2%} on average, "
                f"{_sure(figures['middle'], 2 * figures['middle_standard_error'])} in the middle, "
                f"at most {figures['largest']:.2%}",
                f"  the estimate without tracing is off by at most "
                f"{figures['off_the_estimate']:.1%}",
            )
    provenance = {
        "scene": scene.name,
        "digest": scene.digest,
        "seed": seed,
        "samples": maps[0].samples,
        "version": version("domesim"),
    }
    stored = CrosstalkMaps(
        tuple(scene.seats),
        np.stack([traced.share for traced in maps]),
        np.stack([traced.standard_error for traced in maps]),
        provenance,
    )
    stored.save(out)
    console.say(
        f"  -> {out}",
        f"Use it: domesim compensate --left L.####.exr --right R.####.exr "
        f"--scene {name} --transport {out}",
    )
    finish(console, {"scene": scene.name, "output": str(out), "seats": rows}, [])


def _sure(share: float, error: float) -> str:
    """``1.098% ± 0.00030%``: the error with two significant digits."""
    if not error > 0:
        return f"{share:.3%} ± 0%"
    digits = max(0, 1 - math.floor(math.log10(100 * error)))
    return f"{share:.3%} ± {error:.{digits}%}"


def _finish(console: Console, figures: dict[str, Any], interrupted: bool) -> None:
    """Print the figures; what is not as sure as was asked for is no success."""
    finish(console, figures, [])
    if interrupted:
        raise typer.Exit(INTERRUPTED)


def _require_seed(seed: int) -> None:
    if seed < 0:
        raise InputError(f"--seed must be at least 0, got {seed}")


def _per_primary(values: NDArray[np.float64]) -> str:
    if np.ptp(values) < 1e-12:
        return f"{values[0]:.4f}"
    return " / ".join(f"{value:.4f}" for value in values)


def _closed_gain(scene: DomeScene) -> NDArray[np.float64]:
    from domesim.observation.spherical import bare_transport  # noqa: PLC0415

    return bare_transport(scene.theatre).mean_gain()


def _second_opinion(
    scene: DomeScene, first_opinion: Tabulation, console: Console
) -> dict[str, Any] | None:
    """The mean light by the other method: radiosity, or walks where radiosity was the first."""
    from domesim.observation.radiosity import radiosity  # noqa: PLC0415
    from domesim.pathtrace.tabulate import tabulate as traced  # noqa: PLC0415

    theatre, method = replace(scene.theatre, lamps=()), "radiosity"
    words = method
    if first_opinion.walks == 0:
        method = "path tracing"
        walked = traced(theatre, error=1e-3, most=1e8, explicit=False)
        other, words = walked.transport, f"{method} {_after(walked.walks)}"
    else:
        try:
            other = radiosity(theatre)
        except InputError as reason:
            known, _, _ = str(reason).partition(";")  # its way out is what has just been done
            console.say(f"No second opinion: {known}")
            return None
    gain, first = other.mean_gain(), first_opinion.transport.mean_gain()
    # Of a black primary there is nothing to compare.
    apart = float(np.max(np.abs(gain - first) / np.maximum(first, 1e-30)))
    console.say(f"Second opinion: {words} finds {_per_primary(gain)}, {apart:.2%} apart")
    return {"method": method, "mean_gain": gain.tolist(), "apart": apart}


def _after(walks: int) -> str:
    """How many paths were traced, in words."""
    return f"after {walks:,.0f} paths" if walks else "by radiosity alone"


def _picture(
    scene: DomeScene, path: Path, size: int | None, repair: bool, console: Console
) -> NDArray[np.float32]:
    """(row, col, primary) light of the master, at another size if wanted."""
    with about(path):
        frame = read_master([path], repair=repair, colour=scene.projector.response)
        if frame.repaired:
            console.say(f"{path.name}: {frame.repaired} impossible samples repaired")
        light = np.asarray(decoded(frame, scene)[0], np.float32)
        scene.dome.inside(*light.shape[:2])  # refuses what is no domemaster
    if size is None or size == light.shape[0]:
        return light
    return _resized(light, size, size)


def _resized(picture: NDArray[Any], rows: int, cols: int) -> NDArray[np.float32]:
    import OpenImageIO as oiio  # noqa: N813, PLC0415

    source = oiio.ImageBuf(oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.FLOAT))
    source.set_pixels(oiio.ROI.All, np.ascontiguousarray(picture, np.float32))
    resized = oiio.ImageBufAlgo.resize(source, "box", roi=oiio.ROI(0, cols, 0, rows, 0, 1, 0, 3))
    return np.asarray(resized.get_pixels(oiio.FLOAT), np.float32)


def _small(picture: NDArray[Any]) -> NDArray[Any]:
    """A picture of at most `_PREVIEW` pixels a side."""
    rows, cols = picture.shape[:2]
    shrink = _PREVIEW / max(rows, cols)
    if shrink >= 1:
        return picture
    return _resized(picture, max(1, round(rows * shrink)), max(1, round(cols * shrink)))


def _cutaway(
    scene: DomeScene, picture: NDArray[np.float32], out: Path, width: int, console: Console
) -> None:
    from domesim.pathtrace.cutaway import cutaway, to_png  # noqa: PLC0415

    console.say("Rendering the theatre from outside (about a minute)")
    shown = np.clip(_display(scene, picture), 0, 1)
    to_png(cutaway(scene.theatre, shown, width=width, height=width * 2 // 3), out)
    console.say(f"  -> {out}")
    finish(console, {"scene": scene.name, "view": "cutaway", "output": str(out)}, [])


def _domemaster(
    scene: DomeScene, picture: NDArray[np.float32], settings: Settings, console: Console
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    from domesim.pathtrace.layers import layers_of  # noqa: PLC0415
    from domesim.pathtrace.observation import PathTracedDome  # noqa: PLC0415

    rows, cols, _ = picture.shape
    with console.share("tracing") as progress:
        dome = PathTracedDome(scene.theatre, rows, cols, settings, progress=progress)
        seen = dome.trace(picture[None])
    layers = layers_of(seen, dome.screen)
    parts = [part for part in (seen.indirect, seen.ambient) if part is not None]
    return layers, _facts(parts, dome.screen)


def _from_seat(
    scene: DomeScene,
    picture: NDArray[np.float32],
    view: str,
    width: int,
    settings: Settings,
    console: Console,
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    from domesim.pathtrace.layers import bounces_of  # noqa: PLC0415
    from domesim.pathtrace.observation import in_haste, part_of  # noqa: PLC0415
    from domesim.pathtrace.tracer import Tracer  # noqa: PLC0415

    known = scene.theatre.viewpoints
    name = view.removeprefix("seat:")
    if not view.startswith("seat:") or name not in known:
        seats = sorted(known, key=lambda seat: (seat.startswith("row"), seat))
        few = ", ".join(f"seat:{seat}" for seat in seats[:6])
        raise InputError(
            f"--view {view!r} is not known; use domemaster, cutaway"
            + (f", {few}{' ...' if len(seats) > 6 else ''}" if few else
               f" (the scene {scene.name!r} has no seats or viewpoints)")
        )  # fmt: skip
    tracer = Tracer(scene.theatre)
    source = tracer.picture(picture)
    height = width * 9 // 16
    parts = 2 if scene.theatre.lamps else 1
    with console.share("tracing") as progress:
        seen = tracer.view(source, known[name], width, height, replace(settings, per_bounce=True),
                           progress=part_of(progress, 0, parts))  # fmt: skip
        lamps = None
        if scene.theatre.lamps:
            lamps = tracer.view(
                tracer.lamps(),
                known[name],
                width,
                height,
                in_haste(settings, seen),
                reference=float(seen.mean.mean()),
                progress=part_of(progress, 1, parts),
            )
    assert seen.bounces is not None
    layers = {
        "": seen.mean,
        "direct": seen.bounces[0],
        "indirect": seen.mean - seen.bounces[0],
        "variance": seen.standard_error**2,
    }
    if lamps is not None:
        layers["ambient"] = np.asarray(
            lamps.mean + tracer.visible_lamps(known[name], width, height), np.float32
        )
        layers[""] = seen.mean + layers["ambient"]
        layers["variance"] = layers["variance"] + lamps.standard_error**2
    if settings.per_bounce:
        layers |= bounces_of(seen.bounces)
    traced = [seen] if lamps is None else [seen, lamps]
    return layers, _facts(traced, np.ones((height, width), bool))


def _facts(parts: Sequence[Traced], on: NDArray[np.bool_]) -> dict[str, Any]:
    """Figures of the picture's light, and of the lamps' if there are any, on (row, col) pixels."""
    picture = parts[0]
    count = 3 * np.count_nonzero(on)
    mean = float(np.sum(picture.mean, where=on[..., None], dtype=np.float64)) / count
    square = np.einsum("ij,ijp->", on, np.square(picture.standard_error), dtype=np.float64)
    error = float(np.sqrt(square / count))
    return {
        "status": _worst(part.status.value for part in parts),
        "samples": picture.samples,
        "seed": picture.seed,
        "bounces": picture.limit,
        "segments": sum(part.steps for part in parts),
        "cpu_s": sum(part.seconds for part in parts),
        "relative_error": error / mean if mean else 0.0,
    }


def _worst(statuses: Iterable[str]) -> str:
    from domesim.pathtrace.tracer import Status  # noqa: PLC0415

    # Its members stand in the order of how well it went
    order = [status.value for status in Status]
    return max(statuses, key=order.index)


def _write(
    scene: DomeScene,
    view: str,
    layers: dict[str, NDArray[Any]],
    facts: dict[str, Any],
    out: Path,
    console: Console,
) -> dict[str, Any]:
    """Writes the layers and a preview; returns the figures."""
    from domesim.pathtrace.cutaway import to_png  # noqa: PLC0415
    from domesim.pathtrace.layers import write_layers  # noqa: PLC0415

    white = scene.projector.white
    for name, layer in layers.items():
        np.multiply(layer, white**2 if name == "variance" else white, out=layer)
    attributes: dict[str, Any] = {
        "domesim:scene": scene.name,
        "domesim:digest": scene.digest,
        "domesim:units": "cd/m2 (white of each primary is the luminance of projector white)",
        "domesim:white_cd_m2": float(white),
        "domesim:versions": f"domesim {version('domesim')}, mitsuba {version('mitsuba')}, "
        f"drjit {version('drjit')}, Python {platform.python_version()}",
        "chromaticities": _chromaticities(scene),
    }
    attributes |= {f"domesim:{key}": value for key, value in facts.items()}
    write_layers(out, layers, attributes)
    preview = out.with_suffix(".png")
    to_png(np.clip(_display(scene, _small(layers[""]) / white), 0, 1), preview)
    over, rows, cols = "picture", *layers[""].shape[:2]
    share = np.full((rows, cols), 1 / (rows * cols))
    if view == "domemaster":
        over, share = "screen", scene.dome.screen_areas(rows, cols)
        share /= share.sum()
    seen = {
        name or "seen": float(
            np.einsum("ij,ijp->p", share, layer) @ scene.projector.luminance_weights
        )
        for name, layer in layers.items()
        if name in ("", "direct", "indirect", "ambient")
    }
    sky = _sky(scene, layers[""] @ scene.projector.luminance_weights, share > 0)
    console.say(
        f"mean luminance over the {over}, cd/m²: "
        + ", ".join(f"{name} {decimal(value)}" for name, value in seen.items()),
        f"standard error {percent(facts['relative_error'])} of the mean after {facts['samples']} "
        f"paths a pixel, {decimal(facts['cpu_s'], 2)} CPU-s. {facts['status']}",
        f"darker half: {sky['mag_arcsec2']:.1f} mag/arcsec²; faintest star, a point: "
        f"{Faintest(**sky['faintest_star']).told} mag ({SOURCES})",
        f"  -> {out}",
        f"  -> {preview}",
    )
    paths = {"scene": scene.name, "output": str(out), "preview": str(preview)}
    return {**paths, "mean_cd_m2": seen, "darker_half": sky, **facts}


def _sky(scene: DomeScene, luminance: NDArray[Any], on: NDArray[np.bool_]) -> dict[str, Any]:
    """How dark the darker half of a picture is, and the faintest star in it."""
    shown = luminance[on]
    black = float(np.mean(shown[shown <= np.median(shown)]))
    faintest = video_star(scene, max(black, 0.0), 0.0)
    return {
        "cd_m2": black,
        "mag_arcsec2": sky_brightness(black),
        "faintest_star": faintest._asdict(),
    }


def _display(scene: DomeScene, picture: NDArray[Any]) -> NDArray[Any]:
    """(row, col, RGB) linear BT.709."""
    return np.asarray(scene.projector.to_display(np.asarray(picture, np.float32)[None])[0])


def _chromaticities(scene: DomeScene) -> tuple[float, ...]:
    """(x, y) of red, green, blue and white of the projector."""
    matrix = scene.projector.to_xyz
    columns = [*matrix.T, matrix.sum(axis=1)]
    return tuple(float(v) for c in columns for v in (c[:2] / c.sum()))
