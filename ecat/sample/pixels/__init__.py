"""Images of a sample: what colour and depth cameras would have seen of what really happened."""

from __future__ import annotations

from ecat.sample.pixels.renderer import SHUTTER, Renderer, second_camera
from ecat.sample.pixels.seen import SeenFaces
from ecat.sample.pixels.sensors import EXACT_COLOR, EXACT_DEPTH, ColorNoise, DepthNoise
from ecat.sample.pixels.textures import TEXTURES, Texture, distractor

__all__ = [
    "EXACT_COLOR",
    "EXACT_DEPTH",
    "SHUTTER",
    "TEXTURES",
    "ColorNoise",
    "DepthNoise",
    "Renderer",
    "SeenFaces",
    "Texture",
    "distractor",
    "second_camera",
]
