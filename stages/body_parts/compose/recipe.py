"""The recipe of a body: its parts and motion, and further limbs.

    weights = "runs/mine/parts-5"          # as for `pumps measure body-parts`
    motion = "walk.bvh"

    [[limbs]]
    part = "left_arm"
    weights = "runs/mine/parts-5-vae"
    motion = "kick.bvh"                    # by default the body's
    name = "second"                        # is added to the names of its joints
    offset_m = [0.0, -0.15, 0.0]           # from where the limb is on the body, in the frame of the joint it hangs on
    noise = 0.5                            # how far its latent is moved, in standard deviations

Paths are relative to the working folder.
"""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from data_schemas.errors import InputError
from stages.shared.humanoid.decompositions import PART_NAMES
from stages.shared.toml import read_toml


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Limb(_Strict):
    """A further limb; fields as in the module's example."""

    part: str
    weights: str
    motion: str = ""
    name: str = Field("second", pattern=r"^[A-Za-z0-9_]{1,40}$")
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: float = Field(0.0, ge=0, le=100)

    @field_validator("part")
    @classmethod
    def _is_a_limb(cls, value: str) -> str:
        limbs = [name for name in PART_NAMES if name not in ("whole", "upper", "spine")]
        if value not in limbs:
            raise ValueError(f"must be one of {', '.join(limbs)}, not {value}")
        return value


class Recipe(_Strict):
    """The whole file."""

    weights: str
    motion: str
    limbs: tuple[Limb, ...] = ()


def read_body_recipe(path: Path) -> Recipe:
    """The recipe of a file. Raises InputError if it is missing, not TOML, or has other keys."""
    values = read_toml(path, what="recipe", option="the first argument")
    try:
        recipe = Recipe.model_validate(values)
    except ValidationError as error:
        faults = [f"{'.'.join(map(str, each['loc'])) or 'it'}: {each['msg']}" for each in error.errors()]
        raise InputError(
            f"{path} is no recipe of a body: {'; '.join(faults)}.",
            "`pumps body-parts compose --help` shows an example.",
        ) from None
    names = [(limb.part, limb.name) for limb in recipe.limbs]
    if len(set(names)) < len(names):
        raise InputError(f"{path} has two limbs of one part and name.", "Give each a name of its own.")
    return recipe
