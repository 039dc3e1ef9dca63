"""A recording for pages, and what a page holds."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

FRAMES = 41

BVH = """HIERARCHY
ROOT Hips
{{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {{
    OFFSET 0 20 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Head
    {{
      OFFSET 0 40 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {{
        OFFSET 0 20 0
      }}
    }}
{arms}  }}
{legs}}}
"""

LIMB = """  JOINT {side}{upper}
  {{
    OFFSET {x} {y} 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT {side}{lower}
    {{
      OFFSET 0 -{length} 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {{
        OFFSET 0 -{length} 0
      }}
    }}
  }}
"""


def bvh_text() -> str:
    sides = (("Left", 1), ("Right", -1))
    arms = "".join(LIMB.format(side=s, upper="Arm", lower="ForeArm", x=18 * x, y=35, length=28) for s, x in sides)
    legs = "".join(LIMB.format(side=s, upper="UpLeg", lower="Leg", x=10 * x, y=-5, length=45) for s, x in sides)
    rows = []
    for frame in range(FRAMES):
        swing = 20 * np.sin(frame / 6)
        turns = [[0, 0, 0], [0, 5, 0], [0, 0, 0], *([[0, side * swing, 0], [0, 10, 0]] for side in (1, -1, -1, 1))]
        values = [frame * 2.0, 95, 0, *np.concatenate([np.ravel(turn) for turn in turns])]
        rows.append(" ".join(f"{value:.4f}" for value in values))
    header = BVH.format(arms=arms, legs=legs)
    return f"{header}MOTION\nFrames: {FRAMES}\nFrame Time: 0.0333333\n" + "\n".join(rows) + "\n"


class _Page(HTMLParser):
    """Collects what a browser would load, and the text of the scenes element."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.scenes = ""
        self._in_scenes = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        self.loads += [str(named[key]) for key in ("src", "href", "data", "action") if key in named]
        if tag in ("link", "iframe", "object", "embed"):
            self.loads.append(tag)
        self._in_scenes = tag == "script" and named.get("id") == "scenes"

    def handle_endtag(self, tag: str) -> None:
        self._in_scenes = False

    def handle_data(self, data: str) -> None:
        if self._in_scenes:
            self.scenes += data


def parsed(path: Path) -> tuple[_Page, list[dict], str]:
    text = path.read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    return page, json.loads(page.scenes), text
