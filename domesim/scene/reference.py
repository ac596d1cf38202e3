"""The page that lists every key of a scene file: ``make keys`` writes docs/scene-keys.md.

Types, ranges and defaults are those of the models that check a file. Examples are of the bundled
scenes, or given here for keys that none of them has.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from importlib import resources
from typing import Any, NamedTuple

from domesim.host.numbers import decimal
from domesim.scene.dome_file import DomeFile
from domesim.scene.fields import Section
from domesim.scene.flat_file import CinemaFile
from domesim.scene.loading import scene_names
from domesim.scene.stereo_file import StereoFile

_UNITS = {
    "_cd_m2": "cd/m²",
    "_deg": "degrees",
    "_m": "m",
    "_nm": "nm",
    "_lux": "lux",
    "_arcmin": "arcminutes",
    "lumens": "lm",
}
_EXAMPLES: dict[str, Any] = {
    "dome.height_ratio": 0.9,
    "dome.truncated_below_m": -0.5,
    "floor.radius_m": 9.0,
    "wall.radius_m": 9.5,
    "seating.seed": 4,
    "meshes.name": "star ball",
    "meshes.file": "things/ball.stl",
    "meshes.albedo": 0.3,
    "viewpoints.position_m": [0.0, -4.5, -1.5],
    "viewpoints.look_at_m": [0.0, 4.0, 3.0],
    "viewpoints.field_deg": 80.0,
    "projector.response": "bt1886",
    "projector.lens.position_m": [0.5, 0.0, -0.3],
    "projector.lens.corrected": False,
    "projector.units.roll_deg": 5.0,
    "projector.units.shift": [0.0, 0.3],
    "projector.units.mask": "left.mask.png",
    "projector.even_black": "projectors",
    "projector.units.black_cd_m2": 0.0015,
    "projector.units.blends_black": True,
    "projector.units.uplift": "left.uplift.png",
    "ambient.luminance_cd_m2": 0.002,
    "ambient.photograph": "room.jpg",
    "grade.black": "taken-out",
    "grade.ambient": "taken-out",
    "grade.gamut": "clipped",
    "screen.albedo_map": "paint.png",
    "screen.lobe.share": 0.25,
    "screen.lobe.roughness": 0.3,
    "sky.zero_point": 1.6,
    "sky.star_projector.image_arcmin": 1.5,
    "sky.star_projector.zero_point_lux": 4e-6,
    "measured.date": "2026-05-04",
    "measured.survey": "survey.toml",
    "measured.unit": "cd/m²",
    "measured.parameters": ["screen", "floor"],
    "measured.chi2": 310.2,
    "measured.degrees_of_freedom": 297,
    "measured.model_error": 0.01,
    "measured.values": {"screen": [0.42, 0.43, 0.41], "floor": [0.1, 0.1, 0.1]},
    "measured.standard_errors": {"screen": [0.004, 0.004, 0.005], "floor": [0.02, 0.02, 0.02]},
    "measured.correlations": {"R screen": [1.0, -0.3, 0.0, 0.0, 0.0, 0.0]},
    "measured.sha256": {"white.exr": "9f86d081884c7d65..."},
    "room.polarised": True,
    "screen.half_gain_deg": 35.0,
    "stereo.kept_by_reflection": -0.8,
    "crosstalk.share": [0.01, 0.012, 0.015],
    "crosstalk.to_left_error": 0.001,
    "crosstalk.to_right_error": 0.001,
    "crosstalk.readings": "readings.csv",
    "crosstalk.black": "included",
    "crosstalk.allow_negative": True,
    "crosstalk.polarisation.albedo": 0.8,
    "crosstalk.polarisation.projector_retardance_error_deg": [2.0, -1.5],
    "crosstalk.polarisation.glasses_retardance_error_deg": [3.0, 3.0],
    "crosstalk.polarisation.glasses_axis_deg": 90.0,
    "crosstalk.polarisation.wavelengths_nm": [615.0, 545.0, 465.0],
    "crosstalk.polarisation.design_nm": 560.0,
    "crosstalk.views.count": 4,
    "crosstalk.views.neighbours": [0.2, [0.02, 0.03, 0.05]],
    "crosstalk.views.repeats": True,
    "crosstalk.views.matrix": [[0, 0.2, 0.1], [0.2, 0, 0.2], [0.1, 0.2, 0]],
    "seats.weight": 2.0,
    "seats.factor": 1.5,
}
_BEGINS = {DomeFile: "dome", StereoFile: "stereo", CinemaFile: "cinema"}
_LONG = 60
_HEAD = """\
# Keys of scene files

What a scene file may hold, with an example of each key. A key whose default is *none* may be left
out. [theatres.md](theatres.md), [stereo.md](stereo.md) and [flat-cinemas.md](flat-cinemas.md)
explain the keys.
`domesim scene check` finds mistakes. `make keys` writes this page, by the models that check files.
"""


class Key(NamedTuple):
    """One key of a section."""

    section: str
    name: str
    schema: dict[str, Any]
    required: bool
    example: Any

    def row(self) -> str:
        """Row of the key in a table."""
        shape, limits = _shape(self.schema)
        unit = next((unit for end, unit in _UNITS.items() if self.name.endswith(end)), "")
        default = self.schema.get("default")
        if self.required:
            told = "required"
        else:
            told = "none" if default is None or default == {} else f"`{_toml(default)}`"
        example = _toml(self.example)
        example = f"`{example}`" if len(example) <= _LONG else f"`{example[:_LONG]}` ..."
        cells = (f"`{self.name}`", shape, unit, told, limits, example)
        return f"| {' | '.join(cells)} |"


class Part(NamedTuple):
    """A section of a file: its heading, what it is, and its keys."""

    heading: str
    about: str
    keys: tuple[Key, ...]


def page() -> str:
    """The whole page, in Markdown."""
    lines = [_HEAD, "## Dome theatres", "", *_tables(DomeFile)]
    lines += ["## Stereo systems", "", *_tables(StereoFile)]
    lines += ["## 2-D cinemas", "", *_tables(CinemaFile)]
    return "\n".join(lines).rstrip() + "\n"


def parts(model: type[Section]) -> Iterator[Part]:
    """The sections of a kind of file, each after the one that holds it."""
    schema = model.model_json_schema()
    scenes = [
        tomllib.loads(resources.files("scenes").joinpath(f"{name}.toml").read_text())
        for name in scene_names()
        if name.startswith(_BEGINS[model])
    ]
    yield from _parts(schema, schema["$defs"], "", "At the top of the file", scenes)


def _parts(
    schema: dict[str, Any], known: dict[str, Any], path: str, heading: str, scenes: list[Any]
) -> Iterator[Part]:
    """A section, and those within it; `scenes` is what bundled scenes have there."""
    keys, within = [], []
    for name, found in schema["properties"].items():
        place = f"{path}.{name}" if path else name
        values = [each[name] for each in scenes if name in each]
        inner = list(_sections(found, known))
        if not inner:
            example = found.get("const", values[0] if values else _EXAMPLES.get(place))
            keys.append(Key(path, name, found, name in schema.get("required", ()), example))
        for section, form in inner:
            parts = [part for value in values for part in _as_list(value, form)]
            within.append((section, place, form.format(place), parts))
    yield Part(heading, schema.get("description", ""), tuple(keys))
    for section, place, title, values in within:
        yield from _parts(section, known, place, f"`{title}`", values)


def _sections(found: dict[str, Any], known: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """The sections that a key may hold, and how such a heading is written."""
    if "$ref" in found:
        yield known[found["$ref"].rpartition("/")[2]], "[{}]"
    for choice in (*found.get("anyOf", ()), *found.get("oneOf", ())):
        yield from _sections(choice, known)
    for several, form in (("items", "[[{}]]"), ("additionalProperties", "[{}.NAME]")):
        inner = found.get(several)
        if isinstance(inner, dict) and "$ref" in inner:
            yield known[inner["$ref"].rpartition("/")[2]], form


def _as_list(value: Any, form: str) -> list[Any]:
    if form.startswith("[["):
        return list(value)
    return list(value.values()) if "NAME" in form else [value]


def _shape(schema: dict[str, Any]) -> tuple[str, str]:
    """What a value looks like, and between what its numbers lie."""
    choices = [
        each for each in (*schema.get("anyOf", ()), *schema.get("oneOf", ()))
        if each.get("type") != "null"
    ]  # fmt: skip
    if choices:
        forms = [_shape(each) for each in choices]
        return ", or ".join(dict.fromkeys(shape for shape, _ in forms)), forms[0][1]
    if "enum" in schema or "const" in schema:
        return " or ".join(f'`"{each}"`' for each in schema.get("enum", [schema.get("const")])), ""
    kind, limits = _SHAPES.get(schema["type"], ""), _limits(schema)
    if schema["type"] == "object":
        shape, limits = _shape(schema["additionalProperties"])
        kind = f"table: name = {shape}"
    if schema["type"] == "array":
        first = schema.get("prefixItems", ())
        shape, limits = _shape(first[0] if first else schema["items"])
        kind = f"{len(first) or 'list of'} {_plural(shape)}"
    return kind, limits


_SHAPES = {
    "boolean": "`true` or `false`",
    "string": "text",
    "integer": "whole number",
    "number": "number",
}


def _plural(shape: str) -> str:
    if shape.startswith("list of "):
        return shape.replace("list", "lists", 1)
    words = shape.split(" ", 1)
    if words[0].isdigit():
        return f"rows of {shape}"
    return {"text": "texts"}.get(shape, shape if shape.endswith("s") else f"{shape}s")


def _limits(schema: dict[str, Any]) -> str:
    low, high, above, below = (
        schema.get(name) for name in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
    )
    ends = [
        f"{decimal(low, 6)} or more" if low is not None else "",
        f"above {decimal(above, 6)}" if above is not None else "",
        f"at most {decimal(high, 6)}" if high is not None else "",
        f"below {decimal(below, 6)}" if below is not None else "",
    ]
    if low is not None and high is not None:
        return f"{decimal(low, 6)} to {decimal(high, 6)}"
    return ", ".join(filter(None, ends))


def _toml(value: Any) -> str:
    """A value as a TOML file has it."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def _tables(model: type[Section]) -> list[str]:
    lines = []
    for part in parts(model):
        lines += [f"### {part.heading}", "", *part.about.splitlines(), ""]
        if part.keys:
            lines += [
                "| key | type | unit | default | range | example |",
                "| --- | --- | --- | --- | --- | --- |",
                *(key.row() for key in part.keys),
                "",
            ]
    return lines


if __name__ == "__main__":
    print(page(), end="")
