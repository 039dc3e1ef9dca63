"""Bodies that are not humanoid: animals, a hand, a tree; of random sizes, named as their makers name them, moving."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from stages.shared.formats.source_body import SourcePoses, SourceRig

Place = tuple[float, float, float]
FRAMES, FPS = 20, 10.0


class Tree:
    """Joints that are added one by one, parents before children."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        self.names: list[str] = []
        self.parents: list[int] = []
        self.offsets: list[Place] = []

    def add(self, name: str, parent: int, place: Place) -> int:
        self.names.append(name)
        self.parents.append(parent)
        self.offsets.append(place)
        return len(self.names) - 1

    def chain(self, name: str, parent: int, *steps: Place) -> int:
        """Joints one below the other; the last one's index."""
        for index, step in enumerate(steps):
            parent = self.add(f"{name}_{index + 1}", parent, step)
        return parent

    def pair(self, name: str, parent: int, *steps: Place) -> None:
        """A limb on the left (+X) and the same one on the right; steps as on the left."""
        for side, sign in (("L", 1), ("R", -1)):
            self.chain(f"{name}_{side}", parent, *((sign * x, y, z) for x, y, z in steps))

    def line(self, count: int, step: Place) -> list[Place]:
        """Several equal steps."""
        return [step] * count


def crab(tree: Tree) -> None:
    root = tree.add("Root", -1, (0, 0.3, 0))
    body = tree.add("Body", root, (0, 0.05, 0))
    for index in range(int(tree.rng.integers(3, 6))):
        z = 0.2 - 0.1 * index
        tree.pair(f"Leg{index}", body, (0.15, 0, z), (0.15, 0.1, 0), (0.15, -0.1, 0), (0.05, -0.15, 0))
    tree.pair("Arm", body, (0.15, 0.05, 0.25), (0.1, 0.05, 0.15), (0.05, 0, 0.15))
    tree.pair("Eye", body, (0.05, 0.1, 0.25), (0, 0.05, 0))


def spider(tree: Tree) -> None:
    body = tree.add("Thorax", -1, (0, 0.4, 0))
    tree.chain("Abdomen", body, (0, 0.05, -0.2), (0, 0.05, -0.3))
    tree.chain("Head", body, (0, 0, 0.15))
    for index in range(4):
        way = np.pi * (index + 0.5) / 4
        out = (np.sin(way), np.cos(way))
        tree.pair(f"Leg{index}", body, (0.1 * out[0], 0, 0.1 * out[1]), (0.2 * out[0], 0.2, 0.2 * out[1]),
                  (0.2 * out[0], -0.3, 0.2 * out[1]), (0.1 * out[0], -0.2, 0.1 * out[1]))  # fmt: skip


def insect(tree: Tree) -> None:
    body = tree.add("Thorax", -1, (0, 0.3, 0))
    front = tree.chain("Spine", body, (0, 0, 0.15), (0, 0, 0.15))
    tree.chain("Head", front, (0, 0.02, 0.1))
    tree.chain("Abdomen", body, (0, 0, -0.2), (0, 0, -0.2))
    for joint, name in ((body, "HindLeg"), (body + 1, "MidLeg"), (front, "ForeLeg")):
        tree.pair(name, joint, (0.05, 0, 0), (0.15, 0.1, 0), (0.1, -0.2, 0), (0.05, -0.15, 0))


def fish(tree: Tree) -> None:
    body = tree.add("Root", -1, (0, 1, 0))
    chest = tree.chain("Spine", body, (0, 0, 0.15), (0, 0, 0.15))
    tree.chain("Head", chest, (0, 0.02, 0.12), (0, 0, 0.12))
    tree.chain("Tail", body, *tree.line(int(tree.rng.integers(3, 6)), (0, 0, -0.15)))
    bones = int(tree.rng.integers(2, 4))
    tree.pair("PectoralFin", chest, (0.08, -0.05, 0), *tree.line(bones, (0.08, -0.02, -0.03)))
    tree.pair("PelvicFin", body, (0.05, -0.08, 0), *tree.line(bones, (0.05, -0.03, -0.03)))
    tree.chain("DorsalFin", body, (0, 0.12, 0), (0, 0.08, -0.05))


def snake(tree: Tree) -> None:
    root = tree.add("Root", -1, (0, 0.05, 0))
    end = tree.chain("Spine", root, *tree.line(int(tree.rng.integers(8, 30)), (0, 0, 0.1)))
    tree.chain("Head", end, (0, 0.02, 0.08), (0, 0, 0.06))
    tree.chain("Jaw", end, (0, -0.02, 0.08))


def _quadruped(tree: Tree, leg: float, back: float, names: tuple[str, str], *, neck: float, tail: int) -> int:
    """A body on four legs; the chest's index."""
    hips = tree.add("Pelvis", -1, (0, leg, 0))
    chest = tree.chain("Spine", hips, *tree.line(3, (0, 0, back / 3)))
    if neck:
        throat = tree.chain("Neck", chest, *tree.line(3, (0, neck / 4, neck / 5)))
        tree.chain("Head", throat, (0, 0.05, 0.1), (0, -0.05, 0.15))
    tree.chain("Tail", hips, *tree.line(tail, (0, -0.05, -0.12)))
    for joint, name, bend in ((hips, names[0], -0.06), (chest, names[1], 0.04)):
        tree.pair(name, joint, (0.12, -0.05, 0), (0, -0.42 * leg, bend), (0, -0.33 * leg, -bend),
                  (0, -0.15 * leg, 0), (0, -0.04 * leg, 0.06))  # fmt: skip
    return chest


def horse(tree: Tree) -> None:
    _quadruped(tree, 1.2, 0.9, ("HindLeg", "ForeLeg"), neck=0.8, tail=4)


def dog(tree: Tree) -> None:
    """Named as a biped's rig, which many animals are made from."""
    _quadruped(tree, 0.5, 0.5, ("Thigh", "UpperArm"), neck=0.3, tail=5)


def lizard(tree: Tree) -> None:
    hips = tree.add("Pelvis", -1, (0, 0.15, 0))
    chest = tree.chain("Spine", hips, *tree.line(4, (0, 0, 0.12)))
    tree.chain("Head", chest, (0, 0.02, 0.12), (0, 0, 0.1))
    tree.chain("Tail", hips, *tree.line(int(tree.rng.integers(5, 9)), (0, 0, -0.13)))
    for joint, name in ((hips, "HindLeg"), (chest, "ForeLeg")):
        tree.pair(name, joint, (0.06, 0, 0), (0.14, 0.02, 0), (0.05, -0.14, 0), (0.02, -0.02, 0.05))


def bird(tree: Tree) -> None:
    hips = tree.add("Root", -1, (0, 0.35, 0))
    chest = tree.chain("Spine", hips, (0, 0.05, 0.1), (0, 0.05, 0.1))
    neck = tree.chain("Neck", chest, *tree.line(3, (0, 0.06, 0.04)))
    tree.chain("Head", neck, (0, 0.03, 0.05), (0, 0, 0.08))
    tree.chain("Tail", hips, (0, 0, -0.12), (0, 0, -0.12))
    tree.pair("Wing", chest, (0.06, 0.03, 0), (0.2, 0.05, 0), (0.25, 0, -0.05), (0.2, 0, -0.1), (0.15, 0, -0.1))
    tree.pair("Leg", hips, (0.05, -0.04, 0), (0, -0.12, 0.06), (0, -0.12, -0.06), (0, -0.06, 0.05))


def centaur(tree: Tree) -> None:
    chest = _quadruped(tree, 1.1, 0.9, ("HindLeg", "ForeLeg"), neck=0.0, tail=4)
    breast = tree.chain("Torso", chest, *tree.line(3, (0, 0.17, 0)))
    tree.chain("Neck", breast, (0, 0.12, 0), (0, 0.1, 0.02))
    tree.pair("Arm", breast, (0.05, 0.05, 0), (0.13, 0, 0), (0.28, 0, 0), (0.25, 0, 0), (0.1, 0, 0))


def dragon(tree: Tree) -> None:
    chest = _quadruped(tree, 0.9, 0.9, ("HindLeg", "ForeLeg"), neck=1.0, tail=9)
    tree.pair("Wing", chest, (0.1, 0.15, 0), (0.5, 0.2, 0), (0.6, 0.1, -0.1), (0.5, 0, -0.2), (0.4, 0, -0.2))


def hand(tree: Tree) -> None:
    wrist = tree.chain("Forearm", tree.add("Elbow", -1, (0, 1, 0)), (0.25, 0, 0))
    for index, name in enumerate(("Thumb", "Index", "Middle", "Ring", "Pinky")):
        z = 0.04 - 0.02 * index
        tree.chain(name, wrist, (0.09 - 0.05 * (index == 0), 0, z), *tree.line(3, (0.03, 0, 0)))


def tree_of_wood(tree: Tree) -> None:
    trunk = tree.chain("Trunk", tree.add("Root", -1, (0, 0, 0)), *tree.line(5, (0, 0.6, 0)))
    for joint in range(2, trunk + 1):
        for branch in range(int(tree.rng.integers(1, 4))):
            way = tree.rng.uniform(0, 2 * np.pi)
            step = (0.35 * np.cos(way), 0.2, 0.35 * np.sin(way))
            end = tree.chain(f"Branch{joint}{branch}", joint, *tree.line(int(tree.rng.integers(1, 4)), step))
            if tree.rng.random() < 0.5:
                tree.pair(f"Twig{joint}{branch}", end, (0.15, 0.15, 0), (0.1, 0.1, 0))


CREATURES: dict[str, Callable[[Tree], None]] = {
    "crab": crab, "spider": spider, "insect": insect, "fish": fish, "snake": snake, "horse": horse, "dog": dog,
    "lizard": lizard, "bird": bird, "centaur": centaur, "dragon": dragon, "hand": hand, "tree": tree_of_wood,
}  # fmt: skip


def creature(kind: str, seed: int) -> tuple[SourceRig, SourcePoses]:
    """One creature of its kind, with bones up to a quarter longer or shorter, left as right; it sways a little."""
    rng = np.random.default_rng(seed)
    tree = Tree(rng)
    CREATURES[kind](tree)
    factors: dict[str, float] = {}
    sizes = [
        factors.setdefault(name.replace("_L_", "_S_").replace("_R_", "_S_"), float(rng.uniform(0.8, 1.25)))
        for name in tree.names
    ]
    offsets = np.array(tree.offsets) * np.array(sizes)[:, None]
    root, offsets[0] = offsets[0].copy(), 0.0
    joints = len(tree.names)
    rig = SourceRig(
        names=tuple(tree.names), parents=tuple(tree.parents), offsets=tuple(map(tuple, offsets.tolist())),
        end_sites=((0.0, 0.0, 0.0),) * joints, placed=tuple(joint == 0 for joint in range(joints)),
    )  # fmt: skip
    times = np.arange(FRAMES) / FPS
    phases, reach = rng.uniform(0, 6, (joints, 3)), rng.uniform(0, 0.15, (joints, 3))
    turns = np.sin(3 * times[:, None, None] + phases) * reach
    turns[:, 0] *= 0.2
    local = Rotation.from_rotvec(turns.reshape(-1, 3)).as_quat().reshape(FRAMES, joints, 4)
    roots = root + np.stack([0 * times, 0 * times, 0.5 * times], axis=1)
    return rig, SourcePoses(local, roots, FPS)
