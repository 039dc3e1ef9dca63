"""Run by the Python that has `bpy`: a figure is keyed in Blender, filled by the add-on, and its poses are printed.

    python in_blender.py ADD_ON PROGRAM CASE

It prints one JSON object. Cases: whole, arm (only selected bones), refused, range (keys after it, in which
quaternions have the other sign), empty (an action without keys).
"""

import importlib.util
import json
import math
import sys

import bpy
from mathutils import Euler, Matrix, Vector

BONES = {  # name: parent, head, tail; Z up, facing -Y, in decimetres
    "hips": ("", (0, 0, 9.5), (0, 0, 11)), "chest": ("hips", (0, 0, 11), (0, 0, 14)),
    "neck": ("chest", (0, 0, 14), (0, 0, 15)), "head": ("neck", (0, 0, 15), (0, 0, 17)),
}  # fmt: skip
for side, sign in (("L", 1), ("R", -1)):
    BONES |= {
        f"upper_arm.{side}": ("chest", (2 * sign, 0, 14), (4.7 * sign, 0, 14)),
        f"forearm.{side}": (f"upper_arm.{side}", (4.7 * sign, 0, 14), (7.2 * sign, 0, 14)),
        f"hand.{side}": (f"forearm.{side}", (7.2 * sign, 0, 14), (8.2 * sign, 0, 14)),
        f"thigh.{side}": ("hips", (sign, 0, 9), (sign, 0, 5)),
        f"shin.{side}": (f"thigh.{side}", (sign, 0, 5), (sign, 0, 1)),
        f"foot.{side}": (f"shin.{side}", (sign, 0, 1), (sign, -1.5, 0.2)),
    }
KEYS = (1, 13, 31)


def figure():
    """An armature with rolled bones, a tenth of the size and turned, with keys in three modes of rotation."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 40
    bpy.context.scene.render.fps = 30
    armature = bpy.data.objects.new("Figure", bpy.data.armatures.new("Figure"))
    bpy.context.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    armature.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    for number, (name, (parent, head, tail)) in enumerate(BONES.items()):
        bone = armature.data.edit_bones.new(name)
        bone.head, bone.tail, bone.roll = head, tail, 0.3 * number
        bone.parent = armature.data.edit_bones[parent] if parent else None
    handle = armature.data.edit_bones.new("handle")  # a second root, which is not sent
    handle.head, handle.tail = (0, 5, 0), (0, 6, 0)
    bpy.ops.object.mode_set(mode="POSE")
    armature.matrix_world = Matrix.LocRotScale(Vector((1, 2, 0.1)), Euler((0, 0, 0.7)), Vector((0.1, 0.1, 0.1)))
    for time, frame in enumerate(KEYS):
        for number, bone in enumerate(armature.pose.bones):
            bone.rotation_mode = ("QUATERNION", "XYZ", "ZYX", "AXIS_ANGLE")[number % 4]
            turn = Euler([0.25 * math.sin(1.3 * number + 2.1 * time + axis) for axis in range(3)])
            bone.matrix_basis = turn.to_matrix().to_4x4()
            path = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(bone.rotation_mode)
            bone.keyframe_insert(path or "rotation_euler", frame=frame)
            if bone.name == "hips":
                bone.location = (0.4 * time, 0.3 * time, 0.1 * time)
                bone.keyframe_insert("location", frame=frame)
    armature.animation_data.action.name = "Dance"
    return armature


def turn_signs(curves):
    """Give the quaternions of all keys but the first the other sign, which is the same rotation."""
    for curve in curves:
        for point in curve.keyframe_points if curve.data_path.endswith("quaternion") else ():
            if point.co[0] > KEYS[0]:
                for end in (point.co, point.handle_left, point.handle_right):
                    end[1] *= -1
        curve.update()


def poses(armature):
    """frame -> bone -> rows of its matrix in the world."""
    out = {}
    for frame in range(1, 41):
        bpy.context.scene.frame_set(frame)
        out[frame] = {
            bone.name: [list(row) for row in armature.matrix_world @ bone.matrix] for bone in armature.pose.bones
        }
    return out


def main(add_on, program, case):
    spec = importlib.util.spec_from_file_location("pumps_blender", add_on)
    module = sys.modules["pumps_blender"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    armature = figure()
    bpy.context.preferences.addons.new().module = "pumps_blender"
    module.register()
    bpy.context.preferences.addons["pumps_blender"].preferences.program = program
    scene = bpy.context.scene
    if case == "range":
        scene.frame_end = 20
        turn_signs(module.curves_of(armature))
    if case == "empty":
        armature.animation_data.action = bpy.data.actions.new("Nothing")
    before, old = poses(armature), armature.animation_data.action
    for bone in armature.pose.bones:
        selected = case == "arm" and bone.name.endswith(("arm.L", "hand.L"))
        holder = bone if bpy.app.version >= (5, 0, 0) else bone.bone
        holder.select = selected
    scene.pumps.only_selected = case == "arm"
    if case == "refused":
        armature.pose.bones["forearm.L"].constraints.new("IK")
    error = ""
    try:
        outcome = bpy.ops.pumps.fill()
    except RuntimeError as refused:
        outcome, error = {"CANCELLED"}, str(refused)
    new = armature.animation_data.action
    keyed = sorted(
        {
            point.co[0]
            for curve in module.curves_of(armature)
            for point in curve.keyframe_points
            if point.type != module.FILLED
        }
    )
    after = poses(armature)
    armature.animation_data.action = old
    old_poses = poses(armature)
    module.unregister()
    print()
    print(
        json.dumps(
            {
                "version": bpy.app.version_string,
                "outcome": sorted(outcome),
                "error": error,
                "actions": sorted(action.name for action in bpy.data.actions),
                "new": new.name,
                "keyed": keyed,
                "before": before,
                "after": after,
                "old_is_unchanged": old_poses == before,
            }
        )
    )


main(*sys.argv[1:])
