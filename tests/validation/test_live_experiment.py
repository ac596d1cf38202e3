"""A shader's cost is counted from its text."""

from __future__ import annotations

import pytest

from compensate.live.shader import shader_of
from domesim.frames.encodings import encoding_named
from domesim.scene import load_scene
from validation.experiments.live import TEXEL, cost_of

TEXT = """\
//!TEXTURE TABLE
//!SIZE 4 5
//!FORMAT r32f
00

//!HOOK MAIN
//!DESC first
//!WHEN HOOKED.w 40 = HOOKED.h 30 = *
//!BIND HOOKED
//!BIND TABLE
//!SAVE SMALL
//!WIDTH 10
//!HEIGHT 5
//!COMPUTE 16 16 16 16
vec4 fetch_HOOKED(ivec2 p) { return texelFetch(HOOKED_raw, p, 0); }
vec4 fetch_TABLE(ivec2 p) { return texelFetch(TABLE, p, 0); }
vec2 clip_to(vec2 at, vec2 last) { return clamp(at, vec2(0.0), last); }
vec4 texel(ivec2 at);
void hook() { imageStore(out_image, ivec2(gl_GlobalInvocationID), texel(p)); }
vec4 two(vec2 q) { return fetch_HOOKED(ivec2(q)) + fetch_HOOKED(ivec2(q) + 1); }
vec4 texel(ivec2 p) {
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; i++) for (int j = -1; j <= 1; j++) {
        if (i > j) continue;
        sum += two(vec2(i, j)) + fetch_TABLE(ivec2(i, j));
    }
    for (int i = p.y; i < 64; i += 32) sum += fetch_TABLE(ivec2(i));
    return sum;
}

//!HOOK MAIN
//!DESC second, by groups of threads
//!WHEN HOOKED.w 40 = HOOKED.h 30 = *
//!BIND HOOKED
//!BIND SMALL
//!SAVE TINY
//!WIDTH 2
//!HEIGHT 1
//!COMPUTE 1 1 4 4
vec4 fetch_SMALL(ivec2 p) { return texelFetch(SMALL_raw, p, 0); }
vec2 clip_to(vec2 at, vec2 last) { return clamp(at, vec2(0.0), last); }
vec4 summand(ivec2 square, ivec2 p);
void hook() {
    vec4 sum = vec4(0.0);
    for (int j = 0; j < 6; j += 4) sum += summand(ivec2(j), ivec2(0));
}
vec4 summand(ivec2 square, ivec2 p) { return fetch_SMALL(square) + fetch_SMALL(p); }
"""


def test_texels_and_bytes_are_counted():
    cost = cost_of(TEXT)
    assert cost.passes == 2
    assert cost.fetches == 50 * (4 * 3 * 3 + 2) + 2 * 16 * 1.5 * 2
    assert cost.bytes == TEXEL * (50 + 1200 + 20) + TEXEL * (2 + 50)


@pytest.mark.parametrize("name", ["dome_imax", "stereo_cinema_silver"])
def test_every_pass_of_a_real_one_is_counted(name):
    text = shader_of(load_scene(name), 96, 96, encoding_named("srgb"))
    cost = cost_of(text)
    assert cost.passes == text.count("//!HOOK MAIN") - 1  # but the red frame
    assert cost.passes == text.count("//!COMPUTE")  # drivers take long to draw
    assert cost.fetches > 96 * 96 * 4
