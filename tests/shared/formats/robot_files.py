"""A small humanoid robot as URDF, its joint angles as CSV, and where its links are by plain matrices."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

# Joint, kind, parent link, child link, xyz, rpy, axis, lowest and highest angle.
JOINTS = (
    ("left_hip_pitch_joint", "revolute", "pelvis", "left_hip_pitch_link", (0, 0.06, -0.1), (0, 0, 0), (0, 1, 0)),
    ("left_hip_roll_joint", "revolute", "left_hip_pitch_link", "left_hip_roll_link",
     (0, 0.05, -0.03), (0, -0.175, 0), (1, 0, 0)),
    ("left_knee_joint", "revolute", "left_hip_roll_link", "left_knee_link",
     (-0.08, 0.002, -0.3), (0, 0.175, 0), (0, 1, 0)),
    ("left_ankle_joint", "revolute", "left_knee_link", "left_ankle_link", (0, 0, -0.3), (0, 0, 0), (0, 1, 0)),
    ("right_hip_pitch_joint", "revolute", "pelvis", "right_hip_pitch_link", (0, -0.06, -0.1), (0, 0, 0), (0, 1, 0)),
    ("right_hip_roll_joint", "revolute", "right_hip_pitch_link", "right_hip_roll_link",
     (0, -0.05, -0.03), (0, -0.175, 0), (1, 0, 0)),
    ("right_knee_joint", "revolute", "right_hip_roll_link", "right_knee_link",
     (-0.08, -0.002, -0.3), (0, 0.175, 0), (0, 1, 0)),
    ("right_ankle_joint", "revolute", "right_knee_link", "right_ankle_link", (0, 0, -0.3), (0, 0, 0), (0, 1, 0)),
    ("waist_yaw_joint", "revolute", "pelvis", "waist_link", (0, 0, 0.05), (0, 0, 0), (0, 0, 2)),
    ("torso_mount_joint", "fixed", "waist_link", "torso_link", (-0.004, 0, 0.04), (0, 0.1, 0), (1, 0, 0)),
    ("head_joint", "fixed", "torso_link", "head_link", (0, 0, 0.35), (0, 0, 0), (1, 0, 0)),
    ("left_shoulder_joint", "revolute", "torso_link", "left_shoulder_link",
     (0.004, 0.15, 0.25), (0.28, 0.01, -0.02), (0, 1, 0)),
    ("left_elbow_joint", "revolute", "left_shoulder_link", "left_elbow_link",
     (0.01, 0.02, -0.2), (-0.28, 0, 0), (0.6, 0.8, 0)),
    ("left_wrist_joint", "continuous", "left_elbow_link", "left_wrist_link", (0.2, 0, -0.01), (0, 0, 0), (1, 0, 0)),
    ("right_shoulder_joint", "revolute", "torso_link", "right_shoulder_link",
     (0.004, -0.15, 0.25), (-0.28, 0.01, 0.02), (0, 1, 0)),
    ("right_elbow_joint", "revolute", "right_shoulder_link", "right_elbow_link",
     (0.01, -0.02, -0.2), (0.28, 0, 0), (-0.6, 0.8, 0)),
    ("right_wrist_joint", "continuous", "right_elbow_link", "right_wrist_link",
     (0.2, 0, -0.01), (0, 0, 0), (1, 0, 0)),
    ("left_palm_joint", "fixed", "left_wrist_link", "left_palm_link", (0.07, 0, 0), (0, 0, 0), (1, 0, 0)),
)  # fmt: skip
ANGLES = tuple(name for name, kind, *_ in JOINTS if kind != "fixed")
FOOT = (
    "<collision><origin xyz='0.03 0 -0.03'/><geometry><box size='0.2 0.08 0.02'/></geometry></collision>"
    "<collision><geometry><mesh filename='file:///dev/zero'/></geometry></collision>"
)


@dataclass(frozen=True)
class RobotText:
    """What varies. more: text before </robot>; joints: extra ones; mimics: joint -> (followed, factor, shift)."""

    name: str = "testbot"
    joints: tuple[tuple, ...] = JOINTS
    limits: tuple[float, float] = (-2.0, 2.5)
    mimics: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    solids: str = FOOT
    before: str = "<?xml version='1.0'?>\n"
    more: str = ""

    def urdf(self) -> bytes:
        links = dict.fromkeys(["pelvis", *(link for joint in self.joints for link in joint[2:4])])
        text = [f"{self.before}<robot name='{self.name}'>"]
        text += [f"<link name='{link}'>{self.solids if 'ankle' in link else ''}</link>" for link in links]
        for name, kind, parent, child, xyz, rpy, axis in self.joints:
            mimic = ""
            if name in self.mimics:
                other, factor, shift = self.mimics[name]
                mimic = f"<mimic joint='{other}' multiplier='{factor}' offset='{shift}'/>"
            low, high = self.limits
            text.append(
                f"<joint name='{name}' type='{kind}'><origin xyz='{_words(xyz)}' rpy='{_words(rpy)}'/>"
                f"<parent link='{parent}'/><child link='{child}'/><axis xyz='{_words(axis)}'/>"
                f"<limit lower='{low}' upper='{high}' effort='1' velocity='20'/>{mimic}</joint>"
            )
        return "\n".join([*text, self.more, "</robot>\n"]).encode()

    @property
    def angle_names(self) -> list[str]:
        return [name for name, kind, *_ in self.joints if kind != "fixed" and name not in self.mimics]

    def places(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Places (T, 3) of every joint by its name, in the robot's world, metres."""
        angles = dict(zip(self.angle_names, rows[:, 7:].T, strict=True))
        for name, (other, factor, shift) in self.mimics.items():
            angles[name] = factor * angles[other] + shift
        frames = {"pelvis": (rows[:, :3], Rotation.from_quat(rows[:, 3:7]))}
        out = {"pelvis": rows[:, :3]}
        for name, kind, parent, child, xyz, rpy, axis in self.joints:
            place, turn = frames[parent]
            out[name] = place + turn.apply(np.array(xyz, float))
            turn = turn * Rotation.from_euler("xyz", rpy)
            if kind != "fixed":
                unit = np.array(axis) / np.linalg.norm(axis)
                turn = turn * Rotation.from_rotvec(angles[name][:, None] * unit)
            frames[child] = (out[name], turn)
        return out


def some_rows(frames: int = 12, angles: int = len(ANGLES), seed: int = 0) -> np.ndarray:
    """Rows (T, 7 + M) of a robot that moves smoothly, turned anyhow about the vertical."""
    rng = np.random.default_rng(seed)
    times = np.arange(frames)[:, None] / 30
    waves = 0.4 * np.sin(times * rng.uniform(1, 4, angles) + rng.uniform(0, 6, angles))
    place = np.array([1.0, -2.0, 0.75]) + 0.3 * np.sin(times * [1, 2, 0.5])
    turn = Rotation.from_euler("ZYX", np.hstack([times + seed, 0.1 * np.sin(times), 0.2 * np.cos(times)]))
    return np.hstack([place, turn.as_quat(), waves])


def csv_of(rows: np.ndarray, header: str = "", newline: str = "\n", separator: str = ",") -> bytes:
    """Rows as text with six decimals."""
    lines = [header] if header else []
    lines += [separator.join(f"{value:.6f}" for value in row) for row in rows]
    return (newline.join(lines) + newline).encode()


def _words(values: tuple) -> str:
    return " ".join(str(value) for value in values)
