"""Displays as data: a scene file (TOML) -> projector, viewing, observation.

A dome theatre (`DomeScene`) has a dome; a stereo system (`StereoScene`) has crosstalk.
"""

from domesim.scene.base import Scene
from domesim.scene.dome import DomeScene
from domesim.scene.dome_file import DomeFile
from domesim.scene.loading import load_dome, load_scene, load_stereo, scene_names
from domesim.scene.stereo import StereoScene

__all__ = [
    "DomeFile",
    "DomeScene",
    "Scene",
    "StereoScene",
    "load_dome",
    "load_scene",
    "load_stereo",
    "scene_names",
]
