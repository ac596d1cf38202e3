"""Displays as data: a scene file (TOML) -> projector, viewing, observation.

A dome theatre (`DomeScene`) has a dome; a stereo system (`StereoScene`) has crosstalk; a 2-D cinema
(`CinemaScene`) has a room.
"""

from typing import TypeAlias

from domesim.scene.base import Scene
from domesim.scene.dome import DomeScene
from domesim.scene.dome_file import DomeFile
from domesim.scene.flat import CinemaScene
from domesim.scene.loading import load_dome, load_scene, load_stereo, scene_names
from domesim.scene.stereo import StereoScene

FlatScene: TypeAlias = CinemaScene | StereoScene
"""Either kind of flat screen."""

__all__ = [
    "CinemaScene",
    "DomeFile",
    "DomeScene",
    "FlatScene",
    "Scene",
    "StereoScene",
    "load_dome",
    "load_scene",
    "load_stereo",
    "scene_names",
]
