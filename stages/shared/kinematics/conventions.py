"""The conventions of the whole code.

- Right-handed, Y up, metres, seconds, radians. Sources with another up axis or unit are turned at ingest
  (`Skeleton.up_axis` and `Skeleton.unit_m` store the source's, so that output is written in the same way).
- Unit quaternions in xyzw (as SciPy, RoMa and glTF). Rotations are global; names of others begin with `local_`.
- Shapes: B batch, T frames, J joints, P points, G = 5 body groups, D latent width.
- Body groups, in this order: spine, left_arm, right_arm, left_leg, right_leg (`BODY_GROUPS`).
- Root means the pelvis (`Skeleton.root`), not the first joint of the file.
- Masks are called `known` (True = the frame is given, may be attended) and `valid` (True = a real frame, no padding).
- Models work at 30 frames a second (`MODEL_FPS`); times given to networks are real-valued frames at that rate.
- Random numbers come only from an explicit `numpy.random.Generator` or `torch.Generator` seeded from a config.
"""

from __future__ import annotations

from data_schemas.skeleton import BODY_GROUPS, NO_GROUP

MODEL_FPS = 30.0
GROUPS = len(BODY_GROUPS)
MIRRORED_GROUP = (0, 2, 1, 4, 3)  # left and right exchanged, in the order of BODY_GROUPS
WHOLE_TURN = 6.283185307179586

__all__ = ["BODY_GROUPS", "GROUPS", "MIRRORED_GROUP", "MODEL_FPS", "NO_GROUP", "WHOLE_TURN"]
