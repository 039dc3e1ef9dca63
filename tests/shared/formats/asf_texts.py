"""ASF and AMC texts for tests: a small humanoid with tilted axes, and motion from a seed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.shared.formats.recording import Recording
from stages.shared.kinematics.forward_numpy import positions_of

# Name, parent, direction, length (inches over 0.45), axis, channels.
_BONES: tuple[tuple[str, str, tuple[float, float, float], float, tuple[float, float, float], str], ...] = (
    ("lhipjoint", "root", (0.6, -0.8, 0.0), 2.4, (0, 0, 0), ""),
    ("lfemur", "lhipjoint", (0.34, -0.94, 0.0), 7.2, (0, 0, 20), "rx ry rz"),
    ("ltibia", "lfemur", (0.34, -0.94, 0.0), 7.5, (0, 0, 20), "rx"),
    ("lfoot", "ltibia", (0.07, -0.18, 0.98), 2.4, (-90, 7, 20), "rx rz"),
    ("rhipjoint", "root", (-0.6, -0.8, 0.0), 2.4, (0, 0, 0), ""),
    ("rfemur", "rhipjoint", (-0.34, -0.94, 0.0), 7.2, (0, 0, -20), "rx ry rz"),
    ("rtibia", "rfemur", (-0.34, -0.94, 0.0), 7.5, (0, 0, -20), "rx"),
    ("rfoot", "rtibia", (-0.07, -0.18, 0.98), 2.4, (-90, 7, -20), "rx rz"),
    ("lowerback", "root", (0.0, 1.0, 0.0), 4.5, (0, 0, 0), "rx ry rz"),
    ("upperneck", "lowerback", (0.0, 1.0, 0.05), 4.4, (0, 0, 0), "rx ry rz"),
    ("head", "upperneck", (0.0, 1.0, 0.1), 1.7, (0, 0, 0), "rx ry rz"),
    ("lhumerus", "lowerback", (1.0, 0.1, 0.0), 5.0, (180, 20, -90), "rx ry rz"),
    ("lradius", "lhumerus", (1.0, 0.0, 0.0), 3.3, (5, 90, 10), "rx"),
    ("lhand", "lradius", (1.0, 0.0, 0.0), 1.8, (90, 0, 90), "rx rz"),
    ("rhumerus", "lowerback", (-1.0, 0.1, 0.0), 5.0, (180, -20, 90), "rx ry rz"),
    ("rradius", "rhumerus", (-1.0, 0.0, 0.0), 3.3, (5, -90, -10), "rx"),
    ("rhand", "rradius", (-1.0, 0.0, 0.0), 1.8, (90, 0, -90), "rx rz"),
)


@dataclass
class AsfText:
    """How to spell the skeleton and the motion.

    channels: per bone, other than the usual. axis_order: of every bone. radians: both files. scale: of lengths.
    """

    frames: int = 6
    seed: int = 0
    newline: str = "\r\n"
    length: float = 0.45
    scale: float = 1.0
    order: str = "TX TY TZ RX RY RZ"
    axis_order: str = "XYZ"
    radians: bool = False
    rate: float | None = None
    orientation: tuple[float, float, float] = (0, 0, 0)
    channels: dict[str, str] | None = None

    def bones(self) -> list[tuple[str, str, np.ndarray, float, np.ndarray, list[str]]]:
        return [
            (name, parent, np.array(d) / np.linalg.norm(d), length * self.scale, np.array(axis, float),
             (self.channels or {}).get(name, dof).split())
            for name, parent, d, length, axis, dof in _BONES
        ]  # fmt: skip

    def _angle(self, degrees: float) -> float:
        return float(np.radians(degrees) if self.radians else degrees)

    def asf(self) -> bytes:
        lines = [
            "# made for a test",
            ":version 1.10",
            ":name TEST",
            ":units",
            "  mass 1.0",
            f"  length {self.length}",
        ]
        lines += [f"  angle {'rad' if self.radians else 'deg'}", ":documentation", "   begin is a word here", ":root"]
        tilt = " ".join(repr(self._angle(a)) for a in self.orientation)
        lines += [
            f"   order {self.order}",
            f"   axis {self.axis_order}",
            "   position 0 0 0",
            f"   orientation {tilt}",
        ]
        lines += [":bonedata"]
        for i, (name, _, direction, length, axis, dof) in enumerate(self.bones(), start=1):
            lines += ["  begin", f"     id {i}", f"     name {name}"]
            lines += [f"     direction {' '.join(map(repr, direction.tolist()))}", f"     length {length!r}"]
            lines += [f"     axis {' '.join(repr(self._angle(a)) for a in axis)}  {self.axis_order}"]
            if dof:
                lines += [
                    f"    dof {' '.join(dof)}",
                    "    limits (-160.0 20.0)",
                    *["           (-70.0 70.0)"] * (len(dof) - 1),
                ]
            lines += ["  end"]
        lines += [":hierarchy", "  begin"]
        for parent in dict.fromkeys(parent for _, parent, *_ in _BONES):
            lines.append(f"    {parent} {' '.join(name for name, above, *_ in _BONES if above == parent)}")
        return (self.newline.join([*lines, "  end"]) + self.newline).encode()

    def values(self) -> list[dict[str, np.ndarray]]:
        """Channel values of every frame, angles in degrees."""
        rng = np.random.default_rng(self.seed)
        out = []
        for frame in range(self.frames):
            root = [(f + rng.normal()) * self.scale for f in (0.0, 17.0, 0.3 * frame)]
            turns = dict(zip(("tx", "ty", "tz", "rx", "ry", "rz"), [*root, *rng.normal(0, 20, 3)], strict=True))
            pose = {"root": np.array([turns[channel] for channel in self.order.lower().split()])}
            for name, *_, dof in self.bones():
                if dof:
                    pose[name] = rng.normal(0, 25, len(dof))
            out.append(pose)
        return out

    def amc(self) -> bytes:
        lines = ["#!OML:ASF test.asf", ":FULLY-SPECIFIED", ":RADIANS" if self.radians else ":DEGREES"]
        if self.rate:
            lines.append(f":SAMPLES-PER-SECOND {self.rate:g}")
        kinds = {"root": self.order.lower().split(), **{name: dof for name, *_, dof in self.bones()}}
        for number, pose in enumerate(self.values(), start=1):
            lines.append(str(number))
            for name, values in pose.items():
                told = [self._angle(v) if kind[0] == "r" else v for v, kind in zip(values, kinds[name], strict=True)]
                lines.append(f"{name} {' '.join(repr(float(v)) for v in told)}")
        return (self.newline.join(lines) + self.newline).encode()

    def heads(self) -> np.ndarray:
        """(T, J, 3) the joints in metres, bone by bone with matrices, straight from the format's definition."""
        out = []
        for pose in self.values():
            order = self.order.lower().split()
            root = dict(zip(order, pose["root"], strict=True))
            turn = _fixed([root[c] for c in order if c[0] == "r"], [c[1] for c in order if c[0] == "r"])
            turn = turn @ self._tilt(np.array(self.orientation, float))
            ends = {"root": np.array([root["tx"], root["ty"], root["tz"]])}
            turned, heads = {"root": turn}, {"root": ends["root"]}
            for name, parent, direction, length, axis, dof in self.bones():
                moving = [(v, c[1]) for v, c in zip(pose.get(name, []), dof, strict=True) if c[0] == "r"]
                tilt = self._tilt(axis)
                own = tilt @ _fixed([v for v, _ in moving], [c for _, c in moving]) @ np.linalg.inv(tilt)
                turned[name] = turned[parent] @ own
                heads[name] = ends[parent]
                ends[name] = ends[parent] + turned[name] @ direction * length
            out.append(heads)
        joints = self.depth_first()
        return np.array([[heads[name] for name in joints] for heads in out]) * 0.0254 / self.length

    def _tilt(self, axis: np.ndarray) -> np.ndarray:
        return _fixed([axis["xyz".index(c)] for c in self.axis_order.lower()], list(self.axis_order.lower()))

    def depth_first(self) -> list[str]:
        def below(name: str) -> list[str]:
            return [name, *(inner for child, parent, *_ in _BONES if parent == name for inner in below(child))]

        return below("root")


def _fixed(degrees: list[float], axes: list[str]) -> np.ndarray:
    """Rotation about world axes, one after another."""
    total = np.eye(3)
    for angle, axis in zip(degrees, axes, strict=True):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        step = np.eye(3)
        step[i, i], step[i, j], step[j, i], step[j, j] = c, -s, s, c
        total = step @ total
    return total


def worst_beside_pyacclaim(asf: Path, amc: Path, recording: Recording, frames: Iterable[int]) -> float:
    """Largest distance, metres, of a joint from where an independent reader has it, both from the root."""
    import pyacclaim

    figure = pyacclaim.loadASF(str(asf), verbose=False)
    poses, bones = pyacclaim.loadAMC(figure, str(amc)), figure["bones"]
    skeleton, ours = recording.skeleton, positions_of(recording.skeleton, recording.motion)
    worst = 0.0
    for frame in frames:
        bones["root"].set_pose(poses[frame])
        ends = {name: np.array(bone.global_coordinate) for name, bone in bones.items()}
        above = [skeleton.names[parent] for parent in skeleton.parents[1:]]
        theirs = np.array([ends[name] - ends["root"] for name in above]) * 0.0254  # it has lengths in inches
        worst = max(worst, float(np.abs(ours[frame, 1:] - ours[frame, 0] - theirs).max()))
        place = ends["root"] * 0.0254
        worst = max(worst, float(np.abs(ours[frame, 0] - place).max()))
    return worst
