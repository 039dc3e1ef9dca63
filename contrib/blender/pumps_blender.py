# SPDX-License-Identifier: Apache-2.0
# Copyright the pumps maintainers
"""A Blender add-on: fill the selected armature's action between its keys with `pumps`.

The armature goes to `pumps infill` as a BVH in a temporary folder, and the result comes back as a new action; the old
action stays as it is. What needs no Blender stands first and is tested without it.

Apache-2.0 is compatible with the GNU GPL version 3, under which add-ons are distributed together with Blender.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

try:
    import bpy
    from mathutils import Euler, Matrix
except ImportError:  # outside Blender
    bpy = None

bl_info = {
    "name": "pumps",
    "description": "Fill human motion between the keys of an armature",
    "author": "the pumps maintainers",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > pumps",
    "category": "Animation",
}

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # Blender's x, y, z are a BVH's x, z, -y
STILL_M = 1e-5  # a place that moves less against its parent has no position channels
LOCKED = 1e-7  # cosine of the middle angle below which the first and the last angle are one
FILLED = "JITTER"  # Blender's type of keys "for keying on ones": they are no keys for the next fill
_PATH = re.compile(r'pose\.bones\["((?:[^"\\]|\\.)*)"\]\.(\w+)')
_PARTS = {"spine", "arms", "legs", "left_arm", "right_arm", "left_leg", "right_leg"}
_PARTS |= {"upper_body", "lower_body", "root", "position"}  # words that --constraints does not take for a joint


class Refused(Exception):
    """What cannot be done, in one sentence for the user."""


@dataclass(frozen=True)
class Rig:
    """J bones, in depth-first order: the first is the root, and parents come before their children.

    names: of the bones. parents: (J,) int, -1 for the root.
    rest:  (J, 4, 4) bones' matrices in Blender's world at rest, Z up, metres; rotations without scale.
    tails: (J, 3) from head to tail, in the same axes.
    """

    names: tuple[str, ...]
    parents: np.ndarray
    rest: np.ndarray
    tails: np.ndarray

    @property
    def offsets(self) -> np.ndarray:
        """(J, 3) heads from their parents' heads at rest, Y up; the root's is zero."""
        heads = self.rest[:, :3, 3]
        out = (heads - heads[self.parents]) @ Y_UP.T
        out[0] = 0.0
        return out


def largest_tree(parents: Sequence[int]) -> list[int]:
    """Indices of the tree with the most bones, depth first."""
    children: dict[int, list[int]] = {}
    for bone, parent in enumerate(parents):
        children.setdefault(parent, []).append(bone)
    trees = []
    for root in children.get(-1, []):
        tree, waiting = [], [root]
        while waiting:
            tree.append(waiting.pop())
            waiting += reversed(children.get(tree[-1], []))
        trees.append(tree)
    return max(trees, key=len, default=[])


def bvh_names(names: Iterable[str]) -> list[str]:
    """Names for a BVH, all different: without blanks, braces, commas, and none that `pumps` takes for a part."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"[^\w.:-]", "_", name) or "bone"
        plain = f"{plain}_bone" if plain in _PARTS else plain
        unique, count = plain, 2
        while unique in found:
            unique, count = f"{plain}_{count}", count + 1
        found.append(unique)
    return found


def bvh_of(rig: Rig, matrices: np.ndarray, fps: float) -> str:
    """The text of a BVH, Y up, metres, whose rest pose is the rig's.

    Args:
        matrices: (T, J, 4, 4) bones in Blender's world; a scale in them is left out.
        fps: frames a second.
    """
    world = Y_UP @ (_unscaled(matrices[..., :3, :3]) @ rig.rest[:, :3, :3].transpose(0, 2, 1)) @ Y_UP.T
    heads = matrices[..., :3, 3] @ Y_UP.T
    above = np.maximum(rig.parents, 0)
    unturned = world[:, above].swapaxes(-1, -2)
    local, places = unturned @ world, (unturned @ (heads - heads[:, above])[..., None])[..., 0]
    local[:, 0], places[:, 0] = world[:, 0], heads[:, 0]
    placed = np.abs(places - rig.offsets).max(axis=(0, 2)) > STILL_M
    placed[0] = True
    turns = np.degrees(np.unwrap(_angles(local), axis=0))
    parts = [part[:, j] for j in range(len(rig.names)) for part in ((places, turns) if placed[j] else (turns,))]
    rows = [" ".join(f"{value:.8f}" for value in row) for row in np.concatenate(parts, axis=1)]
    head = _header(rig, placed)
    return "\n".join([head, "MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / fps:.9f}", *rows, ""])


def matrices_of(text: str, rig: Rig) -> np.ndarray:
    """(T, J, 4, 4) bones in Blender's world of a BVH that has the header of `bvh_of`.

    Raises: Refused if it is the BVH of another rig.
    """
    head, found, motion = text.partition("\nMOTION\n")
    joints = re.findall(r"(?m)^\s*(?:ROOT|JOINT) (\S+)$", head)
    placed = np.array([count == "6" for count in re.findall(r"CHANNELS (\d)", head)])
    if not found or joints != bvh_names(rig.names) or len(placed) != len(joints):
        raise Refused("The result of pumps has other joints than the armature. Fill again.")
    rows = [row.split() for row in motion.splitlines()[2:] if row.strip()]
    if {len(row) for row in rows} != {3 * len(joints) + 3 * int(placed.sum())}:
        raise Refused("The result of pumps has rows of another length. Fill again.")
    values = np.array(rows, dtype=float)
    out = np.tile(np.eye(4), (len(values), len(joints), 1, 1))
    world, heads = np.empty((*out.shape[:2], 3, 3)), np.empty((*out.shape[:2], 3))
    column = 0
    for j, parent in enumerate(rig.parents):
        place = values[:, column : column + 3] if placed[j] else rig.offsets[j]
        column += 3 * placed[j]
        turn = _turns(np.radians(values[:, column : column + 3]))
        column += 3
        world[:, j] = turn if parent < 0 else world[:, parent] @ turn
        heads[:, j] = (
            place if parent < 0 else heads[:, parent] + (world[:, parent] @ np.atleast_2d(place)[..., None])[..., 0]
        )
    out[..., :3, :3] = (Y_UP.T @ world @ Y_UP) @ rig.rest[:, :3, :3]
    out[..., :3, 3] = heads @ Y_UP
    return out


def _header(rig: Rig, placed: np.ndarray) -> str:
    """The text up to MOTION; joints that are `placed` (J,) bool have position channels."""
    names, offsets, lines, depths = bvh_names(rig.names), rig.offsets, ["HIERARCHY"], []
    parents = [*rig.parents.tolist(), -1]
    for j, name in enumerate(names):
        depth = 0 if parents[j] < 0 else depths[parents[j]] + 1
        depths.append(depth)
        pad = "\t" * depth
        kind, places = "JOINT" if depth else "ROOT", "Xposition Yposition Zposition " * bool(placed[j])
        lines += [f"{pad}{kind} {name}", f"{pad}{{", f"{pad}\tOFFSET {_three(offsets[j])}"]
        lines.append(f"{pad}\tCHANNELS {6 if placed[j] else 3} {places}Zrotation Xrotation Yrotation")
        if parents[j + 1] != j:
            lines += [
                f"{pad}\tEnd Site",
                f"{pad}\t{{",
                f"{pad}\t\tOFFSET {_three(Y_UP @ rig.tails[j])}",
                f"{pad}\t}}",
            ]
            after = -1 if parents[j + 1] < 0 else depths[parents[j + 1]]
            lines += ["\t" * level + "}" for level in range(depth, after, -1)]
    return "\n".join(lines)


def _three(vector: np.ndarray) -> str:
    return " ".join(f"{value:.8f}" for value in vector)


def _unscaled(turns: np.ndarray) -> np.ndarray:
    """The rotations nearest to (..., 3, 3) matrices."""
    left, _, right = np.linalg.svd(turns)
    return left @ right


def _angles(turns: np.ndarray) -> np.ndarray:
    """(..., 3) angles about Z, X and Y, radians, of rotations (..., 3, 3) = Z X Y."""
    level = np.hypot(turns[..., 2, 0], turns[..., 2, 2])
    free = level > LOCKED
    z = np.where(
        free, np.arctan2(-turns[..., 0, 1], turns[..., 1, 1]), np.arctan2(turns[..., 1, 0], turns[..., 0, 0])
    )
    y = np.where(free, np.arctan2(-turns[..., 2, 0], turns[..., 2, 2]), 0.0)
    return np.stack([z, np.arctan2(turns[..., 2, 1], level), y], axis=-1)


def _turns(angles: np.ndarray) -> np.ndarray:
    """The inverse of `_angles`."""
    (sz, sx, sy), (cz, cx, cy) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [cz * cy - sz * sx * sy, -sz * cx, cz * sy + sz * sx * cy],
        [sz * cy + cz * sx * sy, cz * cx, sz * sy - cz * sx * cy],
        [-cx * sy, sx, cx * cy],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def bone_of_path(path: str) -> str | None:
    """The bone whose place, rotation or scale an F-curve of this data path moves, or None."""
    found = _PATH.fullmatch(path)
    moved = found and found[2].startswith(("location", "rotation_", "scale"))
    return re.sub(r"\\(.)", r"\1", found[1]) if found and moved else None


def key_frames(times: Iterable[float], first: int, last: int) -> list[int]:
    """The frames of keys at `times` from `first` to `last`; a key between two frames counts for the nearest.

    Raises: Refused if nothing lies between the keys.
    """
    frames = sorted({frame for frame in map(round, times) if first <= frame <= last})
    if len(frames) < 2:
        raise Refused(f"There are {len(frames)} keys from frame {first} to {last}. Set two or more.")
    if frames[-1] - frames[0] + 1 == len(frames):
        raise Refused("Every frame between the first and the last key has a key. Delete those to fill.")
    return frames


def constraints_of(keys: Sequence[int], joints: Sequence[str] = ()) -> str:
    """The JSON of `pumps infill --constraints`: keys of the whole body, or of some parts while all else stays."""
    frames = ",".join(map(str, keys))
    asked = {"parts": [{"part": ",".join(joints), "frames": frames}]} if joints else {"keyframes": frames}
    return json.dumps({"version": 1, **asked})


class Run:
    """`pumps infill` of a BVH in a temporary folder, which `close` removes."""

    def __init__(self, program: str, bvh: str, constraints: str, options: Sequence[str], timeout_s: float):
        self.folder, self.timeout_s, self.started = (
            Path(tempfile.mkdtemp(prefix="pumps-")),
            timeout_s,
            time.monotonic(),
        )
        (self.folder / "sent.bvh").write_text(bvh, encoding="utf-8")
        (self.folder / "keys.json").write_text(constraints, encoding="utf-8")
        words = [program, "infill", "sent.bvh", "--constraints", "keys.json", *options, "-o", "filled.bvh"]
        try:
            with open(self.folder / "said.txt", "wb") as said:
                self.process = subprocess.Popen(
                    words, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=said, stderr=said,
                    start_new_session=os.name == "posix",
                )  # fmt: skip
        except OSError as error:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise Refused(
                f"{program!r} does not start ({error.strerror}). Set its path in the preferences."
            ) from None

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.started

    def ended(self) -> bool:
        """Whether it has ended. Raises Refused if it takes longer than the timeout."""
        if self.process.poll() is not None:
            return True
        if self.seconds > self.timeout_s:
            raise Refused(f"pumps took longer than {self.timeout_s:g} s. Raise the limit in the preferences.")
        return False

    def said(self) -> list[str]:
        """Lines that the ended command printed."""
        return (self.folder / "said.txt").read_text(encoding="utf-8", errors="replace").splitlines()

    def result(self) -> str:
        """The filled BVH of the ended command. Raises Refused with its error."""
        if self.process.returncode:
            raise Refused(" ".join(self.said()[-2:]) or f"pumps ended with code {self.process.returncode}.")
        return (self.folder / "filled.bvh").read_text(encoding="utf-8")

    def close(self) -> None:
        """End the command if it runs, and remove the folder."""
        if self.process.poll() is None:
            if os.name == "posix":
                with suppress(OSError):  # it may end meanwhile
                    os.killpg(self.process.pid, signal.SIGKILL)
            else:
                self.process.kill()
            self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)


if bpy is not None:

    @dataclass
    class Sent:
        """What was sent: names in Blender, frames of the scene, (T, 4, 4) matrices of the armature object."""

        armature: str
        action: str
        rig: Rig
        changed: list[str]
        frames: list[int]
        keys: list[int]
        objects: np.ndarray
        metres: float

    def curves_of(armature):
        """The F-curves of the armature's action: Blender 4.4 and newer keep them by slot."""
        animation = armature.animation_data
        slot = getattr(animation, "action_slot", None)
        if slot is None:
            return getattr(animation.action, "fcurves", ())  # Blender 5 has none without a slot
        strips = [strip for layer in animation.action.layers for strip in layer.strips]
        bag = strips[0].channelbag(slot) if strips else None
        return bag.fcurves if bag else ()

    def rig_of(armature, metres: float) -> Rig:
        """The largest tree of the armature's bones. Raises Refused for bones that do not follow their keys alone."""
        scale = np.array(armature.matrix_world.to_scale())
        if np.ptp(scale) > 1e-3 * scale.max() or scale.min() <= 0:
            raise Refused(f"{armature.name!r} is scaled unevenly. Apply its scale (Ctrl A).")
        bones = list(armature.data.bones)
        order = largest_tree([bones.index(bone.parent) if bone.parent else -1 for bone in bones])
        bones = [bones[index] for index in order]
        for bone in bones:
            if any(not each.mute and each.influence > 0 for each in armature.pose.bones[bone.name].constraints):
                raise Refused(
                    f"Bone {bone.name!r} has constraints. Bake the action first (Pose > Animation), and clear them."
                )
        turn = np.array(armature.matrix_world.to_quaternion().to_matrix())
        rest = np.array([bone.matrix_local for bone in bones]).reshape(-1, 4, 4)
        tails = np.array([bone.tail_local - bone.head_local for bone in bones]).reshape(-1, 3)
        size = scale.mean() * metres
        rest[:, :3, :3], rest[:, :3, 3] = turn @ rest[:, :3, :3], size * rest[:, :3, 3] @ turn.T
        parents = [bones.index(bone.parent) if bone.parent else -1 for bone in bones]
        return Rig(tuple(bone.name for bone in bones), np.array(parents), rest, size * tails @ turn.T)

    def sent_of(context) -> tuple[Sent, str, str]:
        """What to send of the selected armature, with its BVH and its constraints. Raises Refused."""
        armature, scene = context.object, context.scene
        if armature is None or armature.type != "ARMATURE":
            raise Refused("Select an armature.")
        if armature.animation_data is None or armature.animation_data.action is None:
            raise Refused(f"{armature.name!r} has no action. Set keys, or choose an action in the Action Editor.")
        metres = scene.unit_settings.scale_length
        rig = rig_of(armature, metres)
        picked = {bone.name for bone in context.selected_pose_bones or ()} & set(rig.names)
        partly = scene.pumps.only_selected and bool(picked)
        times = [
            point.co[0]
            for curve in curves_of(armature)
            if bone_of_path(curve.data_path) in (picked or rig.names)
            for point in curve.keyframe_points
            if point.type != FILLED
        ]
        preview = scene.use_preview_range
        first = scene.frame_preview_start if preview else scene.frame_start
        last = scene.frame_preview_end if preview else scene.frame_end
        keys = key_frames(times, first, last)
        frames = list(range(keys[0], keys[-1] + 1))
        objects, matrices = sampled(armature, scene, rig, frames)
        matrices[..., :3, 3] *= metres
        changed = [name for name in rig.names if name in picked or not partly]
        sent = Sent(armature.name, armature.animation_data.action.name, rig, changed, frames, keys, objects, metres)
        joints = [joint for joint, name in zip(bvh_names(rig.names), rig.names, strict=True) if name in picked]
        parts = [*joints, *["position"] * (rig.names[0] in picked)] if partly else []
        fps = scene.render.fps / scene.render.fps_base
        return sent, bvh_of(rig, matrices, fps), constraints_of([key - keys[0] for key in keys], parts)

    def sampled(armature, scene, rig: Rig, frames: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """(T, 4, 4) matrices of the object, (T, J, 4, 4) of its bones in the world. Refuses scaled bones."""
        objects, poses = np.empty((len(frames), 4, 4)), np.empty((len(frames), len(rig.names), 4, 4))
        shown = scene.frame_current, scene.frame_subframe
        for t, frame in enumerate(frames):
            scene.frame_set(frame)
            objects[t] = armature.matrix_world
            poses[t] = [armature.pose.bones[name].matrix for name in rig.names]
        scene.frame_set(shown[0], subframe=shown[1])
        scales = np.abs(np.linalg.norm(poses[..., :3, :3], axis=-2) - 1).max(axis=(0, 2))
        if scales.max() > 1e-3:
            raise Refused(f"Bone {rig.names[scales.argmax()]!r} is scaled. Clear the scale of its pose.")
        return objects, objects[:, None] @ poses

    def take_back(scene, sent: Sent, bvh: str) -> str:
        """Put the result on a copy of the action, which becomes the armature's, and return the copy's name.

        Every bone that was filled gets a key in every frame; values in key frames are those of the old action.
        Raises Refused if the armature or its action is gone.
        """
        armature, old = bpy.data.objects.get(sent.armature), bpy.data.actions.get(sent.action)
        if armature is None or old is None or not set(sent.rig.names) <= set(armature.pose.bones.keys()):
            raise Refused("The armature or its action was removed or renamed. Fill again.")
        worlds = matrices_of(bvh, sent.rig)
        if len(worlds) != len(sent.frames):
            raise Refused(f"The result of pumps has {len(worlds)} frames of {len(sent.frames)}. Fill again.")
        worlds[..., :3, 3] /= sent.metres
        poses = np.linalg.inv(sent.objects)[:, None] @ worlds
        poses[..., :3, :3] = _unscaled(poses[..., :3, :3])
        new = old.copy()
        new.name, old.use_fake_user = f"{old.name} filled", True
        armature.animation_data.action = new
        for j, name in enumerate(sent.rig.names):
            if name in sent.changed:
                above = poses[:, sent.rig.parents[j]] if sent.rig.parents[j] >= 0 else None
                _key_bone(armature, name, poses[:, j], above, sent)
        scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        return new.name

    def _key_bone(armature, name: str, poses: np.ndarray, above: np.ndarray | None, sent: Sent) -> None:
        """Key one bone in every frame, from its (T, 4, 4) and its parent's matrices in the armature's space."""
        bone, mode, curves = armature.pose.bones[name], armature.pose.bones[name].rotation_mode, curves_of(armature)
        kind = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(mode, "rotation_euler")
        rest, given = bone.bone.matrix_local, {}
        found = {
            part: [curves.find(f"{bone.path_from_id()}.{part}", index=i) for i in range(len(getattr(bone, part)))]
            for part in ("location", kind)
        }
        values: dict[str, list[Sequence[float]]] = {"location": [], kind: []}
        for t, frame in enumerate(sent.frames):
            if above is not None:
                given = {"parent_matrix": Matrix(above[t]), "parent_matrix_local": bone.bone.parent.matrix_local}
            local = bone.bone.convert_local_to_pose(Matrix(poses[t]), rest, invert=True, **given)
            turn = local.to_quaternion()
            if kind == "rotation_axis_angle":
                axis, angle = turn.to_axis_angle()
                turn = (angle, *axis)
            elif kind == "rotation_euler":
                turn = turn.to_euler(mode, *[Euler(each, mode) for each in values[kind][-1:]])
            pose = {"location": local.translation, kind: turn}
            for part, rows in values.items():
                row = tuple(pose[part])
                if frame in sent.keys:
                    row = [
                        c.evaluate(frame) if c else v for c, v in zip(found[part], getattr(bone, part), strict=True)
                    ]
                if part == "rotation_quaternion" and rows and np.dot(rows[-1], row) < 0:
                    row = [-value for value in row]  # the same rotation
                rows.append(row)
        moves = above is None or np.abs(values["location"]).max() > STILL_M
        for part in ("location", kind) if moves else (kind,):
            turned = part == "rotation_quaternion" and _is_turned(found[part], bone, sent, values[part])
            for i, curve in enumerate(found[part]):
                curve = curve or curves.new(f"{bone.path_from_id()}.{part}", index=i)
                _key_curve(curve, sent, [float(row[i]) for row in values[part]], turned)

    def _is_turned(curves, bone, sent: Sent, rows: Sequence[Sequence[float]]) -> bool:
        """Whether the last quaternion has the other sign than before, which keys after it then need too."""
        pairs = zip(curves, bone.rotation_quaternion, strict=True)
        last = [curve.evaluate(sent.frames[-1]) if curve else value for curve, value in pairs]
        return float(np.dot(last, rows[-1])) < 0

    def _key_curve(curve, sent: Sent, values: Sequence[float], turned: bool) -> None:
        """Put values of every frame on an F-curve; keys that stand in key frames stay.

        turned: whether the values after the last frame change their sign, as those of a quaternion may.
        """
        points, kept = curve.keyframe_points, set()
        for point in reversed(points):
            frame = point.co[0]
            if frame in sent.keys:
                kept.add(int(frame))
            of_key = frame in sent.keys and point.co[1] * values[int(frame) - sent.frames[0]] < 0
            if frame in (sent.frames[0], sent.frames[-1]):  # new neighbours would move its handles
                point.handle_left_type = point.handle_right_type = "FREE"
            if of_key or (turned and frame > sent.frames[-1]):  # of a quaternion whose sign was changed
                for end in (point.co, point.handle_left, point.handle_right):
                    end[1] *= -1
            elif frame not in sent.keys and sent.frames[0] < frame < sent.frames[-1]:
                points.remove(point, fast=True)
        for frame, value in zip(sent.frames, values, strict=True):
            if frame not in kept:
                points.insert(frame, value, options={"FAST"}, keyframe_type=FILLED).interpolation = "LINEAR"
        curve.update()

    class PumpsPreferences(bpy.types.AddonPreferences):
        bl_idname = __name__

        program: bpy.props.StringProperty(
            name="pumps", default="pumps", subtype="FILE_PATH", description="The program"
        )
        timeout_s: bpy.props.FloatProperty(name="Longest time", default=600, min=1, unit="TIME_ABSOLUTE")

        def draw(self, context):
            self.layout.prop(self, "program")
            self.layout.prop(self, "timeout_s")

    class PumpsSettings(bpy.types.PropertyGroup):
        weights: bpy.props.StringProperty(name="Weights", description="A name or a folder; pumps' own if empty")
        seed: bpy.props.IntProperty(name="Seed", min=0)
        foot_lock: bpy.props.BoolProperty(name="Hold feet", default=True, description="Keep planted feet in place")
        only_selected: bpy.props.BoolProperty(
            name="Selected bones only", description="All other bones stay as they are"
        )

    class PUMPS_OT_fill(bpy.types.Operator):
        """Fill the action between the keys of the selected bones, or of all bones if none is selected"""

        bl_idname, bl_label, bl_options = "pumps.fill", "Fill between keys", {"REGISTER", "UNDO"}

        def execute(self, context):
            """Wait for the result, as a script needs it."""
            return self._guarded(self._wait, context)

        def invoke(self, context, event):
            return self._guarded(self._begin, context)

        def modal(self, context, event):
            if event.type == "ESC":
                return self._finish(context, {"CANCELLED"})
            return self._guarded(self._look, context) if event.type == "TIMER" else {"PASS_THROUGH"}

        def cancel(self, context):
            """Blender ends the operator, as when another file is loaded."""
            self._finish(context, {"CANCELLED"})

        def _guarded(self, step, context):
            try:
                return step(context)
            except Refused as refused:
                self.report({"ERROR"}, str(refused))
                return self._finish(context, {"CANCELLED"})

        def _start(self, context):
            chosen, settings = context.preferences.addons[__name__].preferences, context.scene.pumps
            self.run = self.timer = None
            self.sent, bvh, constraints = sent_of(context)
            options = ["--seed", str(settings.seed), "--foot-lock" if settings.foot_lock else "--no-foot-lock"]
            options += ["--weights", settings.weights] if settings.weights else []
            self.run = Run(bpy.path.abspath(chosen.program), bvh, constraints, options, chosen.timeout_s)

        def _begin(self, context):
            self._start(context)
            self.timer = context.window_manager.event_timer_add(0.2, window=context.window)
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}

        def _look(self, context):
            if self.run.ended():
                return self._take(context)
            context.workspace.status_text_set(f"pumps: {self.run.seconds:.0f} s (Esc cancels)")
            return {"PASS_THROUGH"}

        def _wait(self, context):
            self._start(context)
            while not self.run.ended():
                time.sleep(0.1)
            return self._take(context)

        def _take(self, context):
            name = take_back(context.scene, self.sent, self.run.result())
            for line in self.run.said():
                if line.startswith(("Note:", "Filled")):
                    self.report({"WARNING" if line.startswith("Note:") else "INFO"}, line)
            self.report({"INFO"}, f"The result is the action {name!r}.")
            return self._finish(context, {"FINISHED"})

        def _finish(self, context, outcome):
            if self.run:
                self.run.close()
            if self.timer:
                context.window_manager.event_timer_remove(self.timer)
                context.workspace.status_text_set(None)
            return outcome

    class PUMPS_PT_panel(bpy.types.Panel):
        bl_idname, bl_label, bl_category = "PUMPS_PT_panel", "pumps", "pumps"
        bl_space_type, bl_region_type = "VIEW_3D", "UI"

        def draw(self, context):
            for name in ("weights", "seed", "foot_lock", "only_selected"):
                self.layout.prop(context.scene.pumps, name)
            self.layout.operator("pumps.fill")

    CLASSES = (PumpsPreferences, PumpsSettings, PUMPS_OT_fill, PUMPS_PT_panel)

    def register():
        for each in CLASSES:
            bpy.utils.register_class(each)
        bpy.types.Scene.pumps = bpy.props.PointerProperty(type=PumpsSettings)

    def unregister():
        del bpy.types.Scene.pumps
        for each in reversed(CLASSES):
            bpy.utils.unregister_class(each)
