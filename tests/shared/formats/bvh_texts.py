"""BVH texts for tests: a small humanoid in any spelling, with rows from a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

HUMANOID: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("Hips", "", (0, 0, 0)),
    ("Spine", "Hips", (0, 20, 0)),
    ("Chest", "Spine", (0, 25, 1)),
    ("Neck", "Chest", (0, 20, 0)),
    ("Head", "Neck", (0, 10, 2)),
    ("LeftShoulder", "Chest", (4, 16, 0)),
    ("LeftArm", "LeftShoulder", (12, 0, 0)),
    ("LeftForeArm", "LeftArm", (27, 0, 0)),
    ("LeftHand", "LeftForeArm", (25, 0, 0)),
    ("RightShoulder", "Chest", (-4, 16, 0)),
    ("RightArm", "RightShoulder", (-12, 0, 0)),
    ("RightForeArm", "RightArm", (-27, 0, 0)),
    ("RightHand", "RightForeArm", (-25, 0, 0)),
    ("LeftUpLeg", "Hips", (9, -3, 0)),
    ("LeftLeg", "LeftUpLeg", (0, -42, 1)),
    ("LeftFoot", "LeftLeg", (0, -41, -2)),
    ("LeftToe", "LeftFoot", (0, -6, 13)),
    ("RightUpLeg", "Hips", (-9, -3, 0)),
    ("RightLeg", "RightUpLeg", (0, -42, 1)),
    ("RightFoot", "RightLeg", (0, -41, -2)),
    ("RightToe", "RightFoot", (0, -6, 13)),
)
TURNS = ("Zrotation", "Xrotation", "Yrotation")
PLACES = ("Xposition", "Yposition", "Zposition")


@dataclass
class BvhText:
    """How to spell the humanoid.

    orders: rotation channels by joint name, TURNS where not named. placed: joints with position channels.
    above: name of a still joint above the hips, or "". turned: rotate the world so that Z is up.
    """

    frames: int = 12
    seed: int = 0
    scale: float = 1.0
    frame_time: str = "0.0333333"
    newline: str = "\n"
    indent: str = "  "
    separator: str = " "
    number: str = "{:.6f}"
    orders: dict[str, tuple[str, ...]] | None = None
    placed: tuple[str, ...] = ("Hips",)
    above: str = ""
    end_site: bool = True
    z_up: bool = False
    declared: int | None = None
    names: dict[str, str] | None = None
    row_end: str = ""

    def joints(self) -> list[tuple[str, str, tuple[float, float, float]]]:
        listed = [(n, p, o) for n, p, o in HUMANOID]
        if self.above:
            listed = [(self.above, "", (0, 0, 0)), ("Hips", self.above, (10, 90, -400)), *listed[1:]]
        return [(n, p, tuple(v * self.scale for v in o)) for n, p, o in listed]  # type: ignore[misc]

    def channels(self, name: str) -> tuple[str, ...]:
        turns = (self.orders or {}).get(name, TURNS)
        placed = (*self.placed, self.above) if self.above else self.placed
        return (*PLACES, *turns) if name in placed else turns

    def header(self) -> str:
        lines: list[str] = ["HIERARCHY"]
        self._joint(lines, self.joints()[0][0], 0)
        return self.newline.join(lines) + self.newline

    def _joint(self, lines: list[str], name: str, depth: int) -> None:
        _, parent, offset = next(joint for joint in self.joints() if joint[0] == name)
        pad, s = self.indent * depth, self.separator
        spelled = (self.names or {}).get(name, name)
        lines += [f"{pad}{'JOINT' if parent else 'ROOT'}{s}{spelled}", f"{pad}{{"]
        lines.append(f"{pad}{self.indent}OFFSET{s}{s.join(self.number.format(v) for v in offset)}")
        channels = self.channels(name)
        lines.append(f"{pad}{self.indent}CHANNELS{s}{len(channels)}{s}{s.join(channels)}")
        children = [joint[0] for joint in self.joints() if joint[1] == name]
        for child in children:
            self._joint(lines, child, depth + 1)
        if not children and self.end_site:
            tip = s.join(self.number.format(v * self.scale) for v in (0.0, 8.0, 0.0))
            inner = pad + self.indent
            lines += [f"{inner}End Site", f"{inner}{{", f"{inner}{self.indent}OFFSET{s}{tip}", f"{inner}}}"]
        lines.append(f"{pad}}}")

    def values(self) -> np.ndarray:
        """(T, C): smooth small turns, hips that wander at standing height, still positions elsewhere."""
        rng = np.random.default_rng(self.seed)
        times = np.linspace(0, 2, self.frames)
        columns = []
        for name, _, offset in self.joints():
            for channel in self.channels(name):
                axis = "XYZ".index(channel[0])
                if channel.endswith("rotation"):
                    value = 25 * rng.uniform(0.2, 1) * np.sin(times * rng.uniform(1, 3) + rng.uniform(0, 6))
                    if name == "Hips" and self.z_up and channel == "Xrotation":
                        value = value * 0 + 90.0
                    if name == "Hips" and self.z_up and channel != "Xrotation":
                        value = value * 0
                elif name == "Hips":
                    height = "Z" if self.z_up else "Y"
                    value = (95.0 if channel[0] == height else 30 * np.sin(times + axis)) * self.scale + times * 0
                else:
                    value = np.full(self.frames, float(offset[axis]))
                columns.append(value)
        return np.stack(columns, axis=1)

    def text(self) -> str:
        rows = [self.separator.join(self.number.format(v) for v in row) + self.row_end for row in self.values()]
        head = ["MOTION", f"Frames:{self.separator}{self.declared if self.declared is not None else self.frames}"]
        head.append(f"Frame Time:{self.separator}{self.frame_time}")
        return self.header() + self.newline.join([*head, *rows]) + self.newline

    def data(self) -> bytes:
        return self.text().encode()
