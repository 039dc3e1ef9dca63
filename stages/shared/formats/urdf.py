"""Reading a robot's URDF: links connected by joints, each with a place, an axis and limits; metres, radians, Z up.

Read with expat alone, so that no other file is ever opened: a document type (and with it every entity) is refused,
and meshes are ignored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from xml.parsers import expat

from data_schemas.errors import InputError
from stages.shared.formats.recording import MAX_JOINTS

MAX_URDF_BYTES = 4 << 20
_DEEPEST = 64
_MOST_ELEMENTS = 50_000
_TURNING = ("revolute", "continuous")
_KINDS = (*_TURNING, "prismatic", "fixed", "floating", "planar")

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class UrdfJoint:
    """One joint.

    kind:   "revolute", "continuous", "fixed" or "floating".
    parent, child: names of the links that it joins.
    xyz, rpy: the child link's frame in the parent link's: metres, and radians about fixed axes X, Y, Z.
    axis:   of length 1, in the child link's frame.
    limits: lowest and highest angle in radians, infinite if the file gives none.
    mimic:  the joint whose angle this one follows, "" for none: angle = factor * its angle + shift.
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: Vector
    rpy: Vector
    axis: Vector
    limits: tuple[float, float] = (-math.inf, math.inf)
    mimic: str = ""
    factor: float = 1.0
    shift: float = 0.0

    @property
    def turns(self) -> bool:
        """Whether it turns about an axis, by its own angle or by that of a joint that it mimics."""
        return self.kind in _TURNING


@dataclass(frozen=True)
class UrdfLink:
    """One link. mass_centre: its centre of mass, None if not given. solids: extreme points of its collision solids
    (spheres' centres, boxes' corners, ends of cylinders' and capsules' axes). Both in metres in the link's frame."""

    name: str
    mass_centre: Vector | None = None
    solids: tuple[Vector, ...] = ()


@dataclass(frozen=True)
class Urdf:
    """A robot: a tree of links. joints: in the file's order. root: the link without a parent."""

    name: str
    links: dict[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]
    root: str
    below: dict[str, tuple[UrdfJoint, ...]]


def looks_urdf(data: bytes) -> bool:
    """Whether the start of a file looks like a URDF."""
    return b"<robot" in data[:65536]


@lru_cache(maxsize=16)
def read_urdf(data: bytes, name: str) -> Urdf:
    """Parse a URDF.

    Args:
        data: the file's bytes. name: its name in error messages.
    Raises: InputError naming the file, and the line, joint or link with the fault.
    """
    if len(data) > MAX_URDF_BYTES:
        raise InputError(f"{name} has {len(data) / 1e6:.0f} MB, which is not a robot's description.")
    robot = _Reader(name).read(data)
    if robot.tag != "robot":
        raise InputError(
            f"{name} is XML and no URDF: it begins with <{robot.tag[:40]}>.", "A URDF begins with <robot>."
        )
    if b"${" in data or any(child.tag.startswith("xacro:") for child in robot.children):
        raise InputError(
            f"{name} is a xacro template, which pumps does not expand.", "Run `xacro` on it, and give what it writes."
        )
    links: dict[str, UrdfLink] = {}
    joints: dict[str, UrdfJoint] = {}
    for child in robot.children:
        if child.tag == "link":
            link = _link(child, name)
            if link.name in links:
                raise InputError(f"{name}, line {child.line}: link '{link.name[:60]}' stands twice.")
            links[link.name] = link
        elif child.tag == "joint":
            joint = _joint(child, name)
            if joint.name in joints:
                raise InputError(f"{name}, line {child.line}: joint '{joint.name[:60]}' stands twice.")
            joints[joint.name] = joint
    if len(joints) > MAX_JOINTS:
        raise InputError(f"{name} has {len(joints)} joints, and {MAX_JOINTS} are the most.")
    if not links or not joints:
        raise InputError(f"{name} has {len(links)} links and {len(joints)} joints, which is not a robot.")
    return _tree(robot.attributes.get("name", ""), name, links, tuple(joints.values()))


def _tree(title: str, name: str, links: dict[str, UrdfLink], joints: tuple[UrdfJoint, ...]) -> Urdf:
    """The tree of the links. Raises InputError if they do not form a tree."""
    above: dict[str, str] = {}
    below: dict[str, list[UrdfJoint]] = {}
    named = {joint.name: joint for joint in joints}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise InputError(
                    f"{name}: joint '{joint.name[:60]}' joins the link '{link[:60]}', which is not there."
                )
        if joint.child in above:
            raise InputError(
                f"{name}: link '{joint.child[:60]}' hangs on two joints, '{above[joint.child][:60]}' and"
                f" '{joint.name[:60]}'."
            )
        if joint.mimic and (joint.mimic not in named or named[joint.mimic].mimic or not named[joint.mimic].turns):
            raise InputError(
                f"{name}: joint '{joint.name[:60]}' mimics '{joint.mimic[:60]}', which cannot be followed."
            )
        above[joint.child] = joint.name
        below.setdefault(joint.parent, []).append(joint)
    roots = [link for link in links if link not in above and (link in below or len(links) == 1)]
    if not roots:
        raise InputError(f"{name}: its links go round in a ring.", "One link must hang on no joint.")
    if len(roots) > 1:
        raise InputError(f"{name}: the links '{roots[0][:60]}' and '{roots[1][:60]}' both hang on nothing.")
    reached, waiting = 0, [roots[0]]
    while waiting:
        under = below.get(waiting.pop(), [])
        reached += len(under)
        waiting += [joint.child for joint in under]
    if reached != len(joints):
        raise InputError(f"{name}: some of its links go round in a ring.", "Every link must lead up to one root.")
    return Urdf(title, links, joints, roots[0], {link: tuple(under) for link, under in below.items()})


# --- elements -----------------------------------------------------------------------------------


@dataclass
class _Element:
    tag: str
    attributes: dict[str, str]
    line: int
    children: list[_Element] = field(default_factory=list)

    def first(self, tag: str) -> _Element | None:
        return next((child for child in self.children if child.tag == tag), None)


class _Reader:
    """Builds a tree of elements; refuses document types, deep nesting and too many elements while it reads."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.top: _Element | None = None
        self.open: list[_Element] = []
        self.count = 0
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end

    def read(self, data: bytes) -> _Element:
        try:
            self.parser.Parse(data, True)
        except expat.ExpatError as error:
            raise InputError(
                f"{self.name}, line {error.lineno}: {expat.ErrorString(error.code)}.", "Is this a URDF file?"
            ) from None
        except (ValueError, LookupError):  # an encoding that Python does not have
            raise InputError(f"{self.name} is in an encoding that cannot be read.", "Save it as UTF-8.") from None
        assert self.top is not None  # expat refuses a text without an element
        return self.top

    def _doctype(self, *_: object) -> None:
        raise InputError(
            f"{self.name}, line {self.parser.CurrentLineNumber}: it declares a document type, which no URDF needs.",
            "Take the <!DOCTYPE ...> out.",
        )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = _Element(tag, attributes, self.parser.CurrentLineNumber)
        self.count += 1
        if len(self.open) >= _DEEPEST or self.count > _MOST_ELEMENTS:
            what = "nested deeper" if len(self.open) >= _DEEPEST else "more"
            raise InputError(f"{self.name}, line {element.line}: its elements are {what} than those of any robot.")
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.top = element
        self.open.append(element)

    def _end(self, tag: str) -> None:
        self.open.pop()


def _attribute(element: _Element | None, key: str, where: str) -> str:
    value = "" if element is None else element.attributes.get(key, "").strip()
    if not value:
        raise InputError(f"{where} has no {key}.", "Is this a URDF file?")
    return value


def _numbers(element: _Element | None, key: str, usual: Vector, where: str) -> Vector:
    if element is None or key not in element.attributes:
        return usual
    words = element.attributes[key].split()
    values = tuple(_number(word) for word in words[:4])
    if len(values) != 3 or not all(abs(value) < 1e4 for value in values):
        raise InputError(f"{where}: {key} is '{element.attributes[key][:60]}' and must be three numbers.")
    x, y, z = values
    return x, y, z


def _number(word: str) -> float:
    try:
        return float(word) if "_" not in word else math.nan
    except ValueError:
        return math.nan


def _scalar(element: _Element | None, key: str, usual: float, where: str) -> float:
    if element is None or key not in element.attributes:
        return usual
    value = _number(element.attributes[key])
    if not math.isfinite(value):
        raise InputError(f"{where}: {key} is '{element.attributes[key][:60]}' and must be a number.")
    return value


def _joint(element: _Element, name: str) -> UrdfJoint:
    title = _attribute(element, "name", f"{name}, line {element.line}: a joint")
    where = f"{name}, line {element.line}: joint '{title[:60]}'"
    kind = _attribute(element, "type", where).lower()
    if kind not in _KINDS:
        raise InputError(f"{where} is of the type '{kind[:40]}', and URDF has {', '.join(_KINDS)}.")
    if kind in ("prismatic", "planar"):
        raise InputError(f"{where} is {kind}: it slides, and only joints that turn are read.", "Make it fixed.")
    x, y, z = _numbers(element.first("axis"), "xyz", (1.0, 0.0, 0.0), where)
    length = math.sqrt(x * x + y * y + z * z)
    if kind in _TURNING and length < 1e-6:
        raise InputError(f"{where} has an axis of no length.")
    length = length or 1.0
    origin, limit, mimic = element.first("origin"), element.first("limit"), element.first("mimic")
    low, high = -math.inf, math.inf
    if kind == "revolute" and limit is not None:
        low, high = _scalar(limit, "lower", 0.0, where), _scalar(limit, "upper", 0.0, where)
        if low > high:
            raise InputError(f"{where}: its lower limit {low:g} lies above its upper one {high:g}.")
    return UrdfJoint(
        name=title,
        kind=kind,
        parent=_attribute(element.first("parent"), "link", f"{where}: its parent"),
        child=_attribute(element.first("child"), "link", f"{where}: its child"),
        xyz=_numbers(origin, "xyz", ZERO, where),
        rpy=_numbers(origin, "rpy", ZERO, where),
        axis=(x / length, y / length, z / length),
        limits=(low, high),
        mimic=_attribute(mimic, "joint", f"{where}: its mimic") if mimic is not None else "",
        factor=_scalar(mimic, "multiplier", 1.0, where),
        shift=_scalar(mimic, "offset", 0.0, where),
    )


def _link(element: _Element, name: str) -> UrdfLink:
    title = _attribute(element, "name", f"{name}, line {element.line}: a link")
    where = f"{name}, line {element.line}: link '{title[:60]}'"
    inertial = element.first("inertial")
    centre = None
    if inertial is not None:
        centre = _numbers(inertial.first("origin"), "xyz", ZERO, where)
    solids: list[Vector] = []
    for collision in element.children:
        geometry = collision.first("geometry") if collision.tag == "collision" else None
        if geometry is not None:
            solids += _solid(geometry, collision.first("origin"), where)
    return UrdfLink(title, centre, tuple(solids))


def _solid(geometry: _Element, origin: _Element | None, where: str) -> list[Vector]:
    """Extreme points of a solid; none for a mesh, whose file is never opened."""
    place = _numbers(origin, "xyz", ZERO, where)
    turn = rotation_of(_numbers(origin, "rpy", ZERO, where))
    corners: list[Vector] = []
    if geometry.first("sphere") is not None:
        corners = [ZERO]
    elif (box := geometry.first("box")) is not None:
        a, b, c = _numbers(box, "size", ZERO, where)
        corners = [(i * a / 2, j * b / 2, k * c / 2) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]
    elif (rod := geometry.first("cylinder") or geometry.first("capsule")) is not None:
        half = _scalar(rod, "length", 0.0, where) / 2
        corners = [(0.0, 0.0, -half), (0.0, 0.0, half)]
    return [_moved(turn, corner, place) for corner in corners]


def rotation_of(rpy: Vector) -> tuple[Vector, Vector, Vector]:
    """Rows of the matrix of roll, pitch and yaw: rotations about fixed X, then Y, then Z, in radians."""
    (sx, sy, sz), (cx, cy, cz) = map(math.sin, rpy), map(math.cos, rpy)
    return (
        (cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx),
        (sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx),
        (-sy, cy * sx, cy * cx),
    )


def _moved(turn: tuple[Vector, Vector, Vector], point: Vector, place: Vector) -> Vector:
    x, y, z = (sum(a * b for a, b in zip(row, point, strict=True)) + at for row, at in zip(turn, place, strict=True))
    return x, y, z
