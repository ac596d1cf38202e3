"""Experiments: one module a claim, each with its rationale, what is expected, and a `run`."""

from __future__ import annotations

from collections.abc import Mapping

GROUPS: Mapping[str, tuple[str, ...]] = {
    "Truth: what light does": (
        "closed_form",
        "truth",
        "polarised_crosstalk",
        "domes_in_3d",
        "flat_cinema",
    ),
    "Worth: what the default gains": (
        "quality",
        "people",
        "advice",
        "two_eyes",
        "wrong_model",
        "flicker",
        "stray_light",
        "audiences",
    ),
    "The paper, remade": (
        "fig9_dome",
        "fig4_one_dimension",
        "fig2_fig6_deghosting",
        "fig10_seats",
        "table1",
        "only_visible",
        "user_study",
    ),
    "Measuring": ("surveys", "photographed_crosstalk", "by_eye", "meters", "raws", "in_rooms"),
    "Shows: what it costs": ("costs", "shows", "live"),
}
"""Names of the experiments, in the report's order, by heading."""

EXPERIMENTS: tuple[str, ...] = tuple(name for names in GROUPS.values() for name in names)
