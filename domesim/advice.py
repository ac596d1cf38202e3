"""Commands of other programs that messages and pages advise, in one place.

Each is tried by the real program (``tests/test_advice.py``): what it promises is read from what it
makes. ``IN`` and ``OUT`` stand for a person's files.
"""

from __future__ import annotations

from typing import NamedTuple


class Advice(NamedTuple):
    """A command that people are told to use."""

    program: str
    arguments: str  # with fields in braces for what a message knows
    promise: str

    def given(self, **fields: object) -> str:
        """The command as a person types it."""
        return f"{self.program} {self.arguments.format(**fields)}"


_FILM = "-c:v ffv1 -c:a copy OUT.mkv"
_EXACT = "full_chroma_int+accurate_rnd"  # swscale is up to 3 codes too dark without
_AS_ASSUMED = "setparams=colorspace=bt709:range=tv"  # FFmpeg takes BT.601 where nothing is said
_PIPE = f"-vf {_AS_ASSUMED} -sws_flags {_EXACT} -f rawvideo -pix_fmt rgb24 -"

ADVICE = {
    "one part": Advice(
        "oiiotool", "IN --subimage {number} -o OUT", "one of several parts or pages, as it is"
    ),
    "no alpha": Advice(
        "oiiotool",
        "--iconfig oiio:UnassociatedAlpha 1 IN --ch R,G,B -o OUT",
        "R, G, B as they are stored, without alpha",
    ),
    "grey": Advice(
        "oiiotool", "IN --ch R={grey},G={grey},B={grey} -o OUT", "the one channel as R, G and B"
    ),
    "layer": Advice(
        "oiiotool", "IN --ch R={layer}.R,G={layer}.G,B={layer}.B -o OUT", "one layer as R, G, B"
    ),
    "whole numbers": Advice(
        "oiiotool", "IN -d float --mulc 4294967295 -o OUT", "32-bit integers as floats, by value"
    ),
    "crop": Advice(
        "oiiotool", "IN --crop {window} -o OUT", "the pixels in the display window, as they are"
    ),
    "one view": Advice(
        "oiiotool", "IN --eraseattrib multiView -o OUT", "the same channels, of one view"
    ),
    "clamp": Advice(
        "oiiotool", "IN --clamp:max=100 -o OUT", "light of 100 at most, the rest as it is"
    ),
    "square pixels": Advice(
        "oiiotool", "IN --attrib PixelAspectRatio 1 -o OUT", "the same pixels, said to be square"
    ),
    "stretch": Advice(
        "oiiotool", "IN --resize {cols}x{rows} -o OUT", "the picture in another size"
    ),
    "stretch a film": Advice(
        "ffmpeg", f"-i IN -vf scale={{cols}}:{{rows}},setsar=1 {_FILM}", "a film in another size"
    ),
    "square pixels of a film": Advice(
        "ffmpeg", f"-i IN -vf scale=iw*sar:ih,setsar=1 {_FILM}", "a film of square pixels"
    ),
    "another container": Advice("ffmpeg", "-i IN -c copy OUT.mkv", "the same film in Matroska"),
    "another codec": Advice("ffmpeg", f"-i IN {_FILM}", "the same frames, without loss, and sound"),
    "no alpha of a film": Advice(
        "ffmpeg", f"-i IN -vf lut=c3=maxval {_FILM}", "a film's colours as they are stored, opaque"
    ),
    "alpha of VP9": Advice(
        "ffmpeg", f"-c:v libvpx-vp9 -i IN {_FILM}", "the same frames, with the alpha beside them"
    ),
    "whole frames": Advice(
        "ffmpeg", f"-i IN -vf bwdif=mode=send_frame {_FILM}", "whole frames, at the same rate"
    ),
    "without the gap": Advice(
        "oiiotool",
        "IN --cut {cols}x{high}+0+0 IN --cut {cols}x{high}+0+{low} --mosaic 1x2 -o OUT",
        "both views of frame-packed 3D, one above the other",
    ),
    "a film without the gap": Advice(
        "ffmpeg",
        "-i IN -vf 'split[a][b];[a]crop=iw:{high}:0:0:exact=1[c];"
        f"[b]crop=iw:{{high}}:0:{{low}}:exact=1[d];[c][d]vstack' {_FILM}",
        "both views of a frame-packed film, one above the other",
    ),
    "size of one view": Advice(
        "mkvpropedit",
        "IN --edit track:v1 --set display-{side}={pixels}",
        "the same film, whose display size is that of one view",
    ),
    "develop": Advice("dcraw", "-4 -T IN", "linear light of 16 bits, as IN.tiff"),
    "develop to measure": Advice(
        "dcraw", "-4 -T -o 0 -r 1 1 1 1 IN", "the sensor's own light of 16 bits, as IN.tiff"
    ),
    "a copy": Advice("oiiotool", "IN -o OUT", "the same picture"),
    "plain TIFF": Advice("tiffcp", "-c zip IN OUT", "the same samples, packed as ZIP"),
    "Y4M": Advice(
        "ffmpeg",
        f"-i IN -vf {_AS_ASSUMED},scale=out_color_matrix=bt709:out_range=tv:flags={_EXACT},"
        "format=yuv444p10 -strict -1 -f yuv4mpegpipe -",
        "Y4M of BT.709 in limited range, of R, G, B or a film of BT.709",
    ),
    "Y4M in limited range": Advice(
        "ffmpeg",
        f"-i IN -vf scale=out_range=tv:flags={_EXACT},format=yuv444p -strict -1 -f yuv4mpegpipe -",
        "Y4M in limited range, of full range",
    ),
    "frames of a film": Advice("ffmpeg", f"-i show.mov {_PIPE}", "R, G, B as compensate decodes"),
    "frames of a screen": Advice(
        "ffmpeg",
        "-f x11grab -framerate 60 -video_size {cols}x{rows} -i {screen} -f rawvideo "
        "-pix_fmt rgb24 -",
        "R, G, B as the screen has them",
    ),
    "frames to look at": Advice(
        "ffplay", "-f rawvideo -pixel_format rgb24 -video_size {cols}x{rows} -", "a window"
    ),
    "a film in a player": Advice(
        "mpv", "--glsl-shader={shader} --fullscreen {film}", "the film as the shader shows it"
    ),
    "a film in gpu-next": Advice(
        "mpv",
        "--vo=gpu-next --glsl-shader={shader} --glsl-shader-opts=lift=1,compensating=1 {film}",
        "the same; its options are the shader's lift, and 0 for the film as it is",
    ),
    "a film by its shader": Advice(
        "ffmpeg",
        "-init_hw_device vulkan=v -filter_hw_device v -i show.mov \\\n"
        f"  -vf {_AS_ASSUMED},format=yuv444p10,hwupload,"
        "libplacebo=custom_shader_path=imax.glsl:format=yuv444p10,hwdownload,format=yuv444p10 \\\n"
        "  -c:v prores_ks out.mov",
        "the film as the shader shows it",
    ),
}
"""By what they are for."""
