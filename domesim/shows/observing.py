"""What ``domesim observe`` does to each frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, final

from domesim.frames import Master
from domesim.host.numbers import decimal
from domesim.light import Light
from domesim.scene.choice import SceneChoice
from domesim.scene.screening import decoded, encoded, mean_luminance
from domesim.shows.first_look import shown
from domesim.shows.small import thinned
from domesim.shows.work import Column, Note, Recipe, Work, Write, Writing


@final
@dataclass(frozen=True)
class Observing(Recipe):
    """What the audience sees of each frame, in its own encoding.

    Parameters
    ----------
    scene
        The theatre, or stereo system of one seat.
    """

    scene: SceneChoice

    def work(self, note: Note) -> Work[Any, Any]:
        """See `Recipe`."""
        theatre = self.scene.load()

        def prepare(source: Master) -> tuple[Master, Light]:
            return source, decoded(source, theatre)

        def solve(prepared: tuple[Master, Light]) -> tuple[Master, dict[str, Any], list[Light]]:
            source, light = prepared
            observation = theatre.observation(*light.shape[1:3])
            seen = observation.observe(light)
            result, clipped = encoded(source, seen, theatre, theatre.screen(*light.shape[1:3]))
            direct = observation.direct(light)
            kept = theatre.kept.astype(light.dtype)[:, None, None, :]
            figures = {
                "direct_cd_m2": mean_luminance(direct, theatre),
                "pollution_cd_m2": mean_luminance(seen - direct - kept, theatre),
                "clipped_share": clipped,
            }
            show = theatre.projector.to_display
            return result, figures, [show(thinned(each))[0] for each in (light, seen)]

        def end(
            solved: tuple[Master, dict[str, Any], list[Light]], write: Write
        ) -> tuple[dict[str, Any], str]:
            result, figures, small = solved
            line = (
                f"mean {decimal(figures['direct_cd_m2'])} cd/m² direct, "
                f"{decimal(figures['pollution_cd_m2'])} cd/m² {theatre.pollution} and stray light"
            )
            if clipped := figures["clipped_share"]:
                line += (
                    f"\n  clipped: {clipped:.1%} of the screen, brighter than the file's format "
                    f"can hold; a 32 bit EXR holds it"
                )
            write(result)
            write.small(*small)
            return figures, line

        return Work(prepare, solve, end)

    def settings(self) -> dict[str, Any]:
        """See `Recipe`."""
        return {"command": "observe", **self.scene.settings()}

    @property
    def about(self) -> str:
        """See `Recipe`: what becomes of light without a picture."""
        theatre = self.scene.load()
        return f"{theatre.name}: {theatre.graded}"

    def doubt(self, masters: Iterable[Master]) -> None:
        """See `Recipe`: whether they are pairs, where these are wanted."""
        for _ in shown(masters, self.scene.load()):
            pass

    small = "What is projected, and what is seen"

    def options(self, writing: Writing) -> dict[str, str]:
        """See `Recipe`."""
        return {**self.scene.options(), **writing.options()}

    def columns(self) -> tuple[Column, ...]:
        """See `Recipe`."""
        return (
            Column("pollution_cd_m2", "Pollution", "cd/m²"),
            Column("direct_cd_m2", "Direct light", "cd/m²"),
            Column("clipped_share", "Clipped", "%"),
        )

    def memory(self, rows: int, cols: int) -> int:
        """See `Recipe`."""
        return 400_000_000 + 40 * 4 * rows * cols
