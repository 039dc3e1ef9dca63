"""Which skeleton the measured places belong to: a rig, a known list, or names and parents, matched by names."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, note
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.joint_lists import ALIASES, LISTS, MIDPOINTS, measured_joints
from stages.shared.formats.joint_matching import end_of, matched, plain_name
from stages.shared.formats.measured_positions import MeasuredPositions, sensible_rate
from stages.shared.formats.recording import MAX_JOINTS, Asked

_LIMBS = [
    f"{side}_{joint}"
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
]
_MOST_NAMED = 8
_NO_ENDS: Mapping[str, int] = MappingProxyType({})


@dataclass(frozen=True)
class Frame:
    """The joints to point, parents first, then the End Sites that are measured.

    rest: (J, 3) in the parents' frames. column: (J,) index of the measured joint, or -1. rig_joints: how many of
    the J are joints of the rig; the others are ends. ends: (rig_joints, 3) End Sites of the rig, zeros for none.
    proportions: True if the lengths of `rest` are a body's, so that measured ones can be held against them.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    rest: np.ndarray
    column: np.ndarray
    rig_joints: int
    ends: np.ndarray
    proportions: bool = False


def with_joints(measured: MeasuredPositions, name: str, asked: Asked) -> tuple[MeasuredPositions, Frame]:
    """The places, and the joints that they belong to; a note lists the columns that were left out.

    Raises: InputError naming the file if no skeleton is known, or its joints are not those of the file.
    """
    count = measured.places.shape[1]
    if count > MAX_JOINTS:
        raise InputError(f"{name} has {count} joints, and {MAX_JOINTS} are the most.")
    if measured.names and len(measured.names) != count:
        raise InputError(f"{name} has {count} joints but {len(measured.names)} names.")
    if asked.rig and b"HIERARCHY" in asked.rig[:4096].upper():
        return _on_rig(measured, name, asked)
    if asked.rig:
        measured = _with_sidecar(measured, name, asked)
    listed = asked.rig_name if asked.rig_name in LISTS else None
    if listed is None and not measured.parents:
        listed = _list_of(measured.names)
    if listed is not None:
        return _on_list(measured, name, listed)
    if not measured.names or not measured.parents:
        raise _no_skeleton(measured, name)
    return measured, _on_own(measured, name)


def _no_skeleton(measured: MeasuredPositions, name: str) -> InputError:
    count = measured.places.shape[1]
    fitting = [title for title in LISTS if len(measured_joints(title)) == count]
    if measured.names:
        return InputError(
            f"{name} states no parents, and its {count} names are those of no list that pumps knows.",
            f"Give --skeleton a rig (BVH) with joints of these names or one of {', '.join(LISTS)}, or put a JSON"
            " beside it (docs/formats.md). Markers on the skin are no joints; solve them to joints first.",
        )
    which = f"one of the lists of {count} joints ({', '.join(fitting)})" if fitting else f"one of {', '.join(LISTS)}"
    return InputError(
        f"{name} states no joint names and parents.",
        f"Give --skeleton {which}, or a rig (BVH), or put a JSON beside it (docs/formats.md).",
    )


def _with_sidecar(measured: MeasuredPositions, name: str, asked: Asked) -> MeasuredPositions:
    """The places in the order of a JSON's joints, with its parents and rate."""
    try:
        raw = json.loads(asked.rig) if len(asked.rig) < 4 << 20 else None
        names = tuple(str(each) for each in raw.get("names", measured.names))  # type: ignore[union-attr]
        parents = tuple(int(each) for each in raw.get("parents", measured.parents))  # type: ignore[union-attr]
        fps = measured.fps if raw.get("fps") is None else float(raw["fps"])  # type: ignore[index, union-attr]
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        raise InputError(
            f"{asked.rig_name} states no skeleton.", 'It must hold {"names": [...], "parents": [...], "fps": 60}.'
        ) from None
    fps = None if fps is None else sensible_rate(fps, asked.rig_name)
    if not measured.names or names == measured.names or len(names) != len(parents):
        return replace(measured, names=names, parents=parents, fps=fps)
    if len(names) > MAX_JOINTS:
        raise InputError(f"{asked.rig_name} has {len(names)} joints, and {MAX_JOINTS} are the most.")
    if any(not -1 <= parent < len(names) for parent in parents):
        raise InputError(
            f"{asked.rig_name}: a parent is not one of its {len(names)} joints.", "The root's parent is -1."
        )
    columns, _, measured = _columns(names, measured, name, asked.rig_name)
    kept, parents = _measured_alone(names, parents, columns, asked.rig_name)
    return replace(
        measured,
        places=measured.places[:, columns[kept]],
        names=tuple(names[joint] for joint in kept),
        parents=parents,
        fps=fps,
    )


def _measured_alone(
    names: Sequence[str], parents: Sequence[int], columns: np.ndarray, where: str
) -> tuple[list[int], tuple[int, ...]]:
    """The joints that have a column, and their parents among them: the nearest joint above that has one."""
    kept = [joint for joint in range(len(names)) if columns[joint] >= 0]
    place = {joint: at for at, joint in enumerate(kept)}
    above: dict[int, int] = {-1: -1}  # joint -> the nearest measured joint at or above it
    for joint in range(len(names)):
        line = []
        while joint not in above:
            if columns[joint] >= 0:
                above[joint] = joint
                break
            line.append(joint)
            if len(line) > len(names):
                raise InputError(f"{where}: the parents form a cycle.")
            joint = parents[joint]
        for each in line:
            above[each] = above[joint]
    found = [above[parents[joint]] for joint in kept]
    return kept, tuple(place[parent] if parent >= 0 else -1 for parent in found)


def _list_of(names: Sequence[str]) -> str | None:
    """The list that has these joints, by their names; of lists of landmarks the one that has most of them."""
    given = {plain_name(name) for name in names}
    for title, joints in LISTS.items():
        if given and given == {plain_name(name) for name, *_ in joints()}:
            return title
    fitting = []
    for title in MIDPOINTS:
        joints = [name for name, *_ in LISTS[title]()]
        found = {joints[at] for at in matched(names, joints, ALIASES) if at >= 0}
        if found.issuperset(_LIMBS):
            fitting.append((len(found), -len(joints), title))
    return max(fitting)[-1] if fitting else None


def _on_list(measured: MeasuredPositions, name: str, title: str) -> tuple[MeasuredPositions, Frame]:
    joints = LISTS[title]()
    if not measured.names:
        measured = replace(measured, names=_names_by_place(measured, name, title))
    names = [joint for joint, *_ in joints]
    columns, _, measured = _columns(names, measured, name, f"the list {title}", aliases=ALIASES)
    parents = [names.index(parent) if parent else -1 for _, parent, _ in joints]
    rest = np.array([direction for *_, direction in joints])
    if title in MIDPOINTS:
        measured = _with_midpoints(measured, names, columns, title)
        kept = [joint for joint in range(len(names)) if columns[joint] >= 0]
        if any(parents[joint] not in (-1, *kept) for joint in kept):
            raise InputError(f"{name} lacks joints that others of the list {title} hang on.")
        parents = [kept.index(parents[joint]) if parents[joint] >= 0 else -1 for joint in kept]
        names, rest, columns = [names[joint] for joint in kept], rest[kept], columns[kept]
    return measured, _ordered(names, parents, rest, columns, name)


def _names_by_place(measured: MeasuredPositions, name: str, title: str) -> tuple[str, ...]:
    names = measured_joints(title)
    if measured.places.shape[1] != len(names):
        raise InputError(
            f"{name} has {measured.places.shape[1]} joints without names, but the list {title} has {len(names)}."
        )
    return tuple(names)


def _with_midpoints(
    measured: MeasuredPositions, names: list[str], columns: np.ndarray, title: str
) -> MeasuredPositions:
    """The places with those that lie midway between two measured ones; `columns` gets their indices."""
    added = []
    for joint, ends in MIDPOINTS[title].items():
        at, of = names.index(joint), [columns[names.index(end)] for end in ends]
        if columns[at] >= 0:
            continue
        if min(of) >= 0:
            columns[at] = measured.places.shape[1] + len(added)
            added.append((measured.places[:, of[0]] + measured.places[:, of[1]]) / 2)
        elif joint == "head":  # without ears the nose is all that shows where the head is
            nose = names.index("nose")
            columns[at], columns[nose] = columns[nose], -1
    if not added:
        return measured
    return replace(measured, places=np.concatenate([measured.places, np.stack(added, axis=1)], axis=1), names=())


def _on_rig(measured: MeasuredPositions, name: str, asked: Asked) -> tuple[MeasuredPositions, Frame]:
    rig = read_bvh(asked.rig, asked.rig_name, keep_unreadable_rows=True)
    names = [joint.name for joint in rig.joints]
    ends = {plain_name(joint.name): at for at, joint in enumerate(rig.joints) if joint.end_site is not None}
    columns, end_columns, measured = _columns(names, measured, name, asked.rig_name, ends)
    sites = np.array([joint.end_site or (0.0, 0.0, 0.0) for joint in rig.joints])
    rest = np.array([joint.offset for joint in rig.joints])
    parents = [joint.parent for joint in rig.joints]
    frame = _ordered(names, parents, rest, columns, name, sites, end_columns)
    return measured, replace(frame, proportions=True)


def _on_own(measured: MeasuredPositions, name: str) -> Frame:
    """Joints from names and parents alone: the first frame with all joints is the pose at rest."""
    count = measured.places.shape[1]
    if len(measured.names) != count or len(measured.parents) != count:
        raise InputError(
            f"{name} has {count} joints, {len(measured.names)} names and {len(measured.parents)} parents."
        )
    if any(not -1 <= parent < count for parent in measured.parents):
        raise InputError(f"{name}: a parent is not one of its {count} joints.", "The root's parent is -1.")
    whole = np.isfinite(measured.places).all(axis=(1, 2))
    if not whole.any():
        raise InputError(f"{name}: no frame has all its {count} joints.", "Give --skeleton a rig (BVH).")
    pose = measured.places[int(whole.argmax())]
    rest = pose - pose[list(measured.parents)]
    return _ordered(list(measured.names), list(measured.parents), rest, np.arange(count), name)


def _columns(
    names: Sequence[str],
    measured: MeasuredPositions,
    name: str,
    where: str,
    ends: Mapping[str, int] = _NO_ENDS,
    aliases: Mapping[str, str] | None = None,
) -> tuple[np.ndarray, np.ndarray, MeasuredPositions]:
    """The measured joint of each joint of a skeleton (-1 for none), that of its end, and the places with a note.

    Args:
        ends: plain name -> index of the joints that have an End Site. aliases: as `matched` takes them.
    """
    count = measured.places.shape[1]
    columns, end_columns = np.full(len(names), -1), np.full(len(names), -1)
    if not measured.names:
        if count != len(names):
            raise InputError(f"{name} has {count} joints without names, but {where} has {len(names)}.")
        return np.arange(count), end_columns, measured
    left_out = []
    for column, joint in enumerate(matched(measured.names, names, aliases)):
        end = ends.get(plain_name(end_of(measured.names[column])), -1) if joint < 0 else -1
        if joint >= 0:
            columns[joint] = column
        elif end >= 0 and end_columns[end] < 0:
            end_columns[end] = column
        else:
            left_out.append(measured.names[column])
    if 2 * (columns >= 0).sum() < len([each for each in measured.names if not end_of(each)]):
        raise InputError(
            f"{name}: {where} has no joint '{left_out[0][:60]}'"
            + (f", nor {len(left_out) - 1} more of the {count} that are named." if len(left_out) > 1 else "."),
            "Give its columns the skeleton's joint names.",
        )
    if left_out:
        without = [joint for at, joint in enumerate(names) if columns[at] < 0]
        listed = note(Flag.COLUMNS_LEFT_OUT, where=where, left_out=_some(left_out), without=_some(without))
        measured = replace(measured, notes=(*measured.notes, listed))
    return columns, end_columns, measured


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(name[:60] for name in names[:_MOST_NAMED])
    return shown + (f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else "")


def _ordered(
    names: Sequence[str],
    parents: Sequence[int],
    rest: np.ndarray,
    columns: np.ndarray,
    name: str,
    ends: np.ndarray | None = None,
    end_columns: np.ndarray | None = None,
) -> Frame:
    """The joints, parents first, without those above the topmost measured joint; then the ends that are measured."""
    children: dict[int, list[int]] = {}
    for joint, parent in enumerate(parents):
        children.setdefault(parent, []).append(joint)
    order: list[int] = []
    waiting = children.get(-1, [])[::-1]
    if len(waiting) != 1:
        raise InputError(f"{name}: there are {len(waiting)} roots among the joints, expected one.")
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += children.get(joint, [])[::-1]
    if len(order) != len(names):
        raise InputError(f"{name}: the parents form a cycle.")
    while columns[order[0]] < 0:  # a root that is not measured is dropped; its one child becomes the root
        if len(children.get(order[0], [])) != 1:
            raise InputError(f"{name}: '{names[order[0]][:60]}', the parent of several joints, is not measured.")
        order = order[1:]
    place = {joint: index for index, joint in enumerate(order)}
    ends = np.zeros_like(rest) if ends is None else ends
    end_columns = np.full(len(names), -1) if end_columns is None else end_columns
    sites = [joint for joint in order if end_columns[joint] >= 0]
    return Frame(
        names=(*(names[joint] for joint in order), *(f"End Site of {names[joint]}" for joint in sites)),
        parents=(*(place.get(parents[joint], -1) for joint in order), *(place[joint] for joint in sites)),
        rest=np.concatenate([rest[order], ends[sites]]),
        column=np.concatenate([columns[order], end_columns[sites]]),
        rig_joints=len(order),
        ends=ends[order],
    )
