"""The page of anchor concepts: film strips of each action's concepts, and all anchors in the plane (t-SNE)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.concepts import SegmentedClip, StoredBody
from stages.segment.config import Config
from stages.shared.concepts.body_positions import relative_poses
from stages.shared.concepts.clusters import AnchorConcepts
from stages.shared.concepts.pose_pictures import COLOURS, figure
from stages.shared.markup import Markup, joined, markup
from stages.shared.settings.command_line import command_line

_POSES = 9  # of each concept, those nearest to it
_CELL, _HEIGHT = 78, 150
_MOST_POINTS = 1500  # of one action, in the plane


def page_of(
    clips: Sequence[tuple[ClipRow, StoredBody, SegmentedClip]], concepts: AnchorConcepts, config: Config
) -> bytes:
    """The page as bytes of HTML that opens offline. Training clips alone are shown."""
    body = clips[0][1]
    parts = []
    for action, centres in sorted(concepts.centres.items()):
        mine = [(row, clip) for row, _, clip in clips if clip.action == action and row.split == "train"]
        poses = np.concatenate([relative_poses(clip.positions[clip.anchors], body.groups) for _, clip in mine])
        labels = np.concatenate([concepts.labels[row.clip] for row, _ in mine])
        score = concepts.silhouettes.get(action)
        shown = "" if score is None else f", mean silhouette {score:.2f}"
        parts.append(
            markup(
                "<h2>{}</h2><p>Anchors: {}, clips: {}, concepts: {}{}. First in each row: the concept; then the "
                "anchors nearest to it.</p>{}{}",
                action, len(poses), len(mine), len(centres), shown, _strips(poses, labels, centres, body),
                _plane(poses, labels, config.seed),
            )
        )  # fmt: skip
    page = markup(
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Anchor concepts</title><style>'
        "body{{font-family:sans-serif;margin:2em;max-width:70em}}</style></head><body><h1>Anchor concepts</h1>"
        "<p>Groups of the anchor poses of each action, relative to the pelvis and turned to face the same way. Made "
        "by:</p><pre>{}</pre>{}</body></html>\n",
        command_line("pumps segment", config, arguments=("input",)), joined(parts, "\n"),
    )  # fmt: skip
    return page.encode()


def _strips(poses: np.ndarray, labels: np.ndarray, centres: np.ndarray, body: StoredBody) -> Markup:
    width, height = (_POSES + 1) * _CELL + 60, _HEIGHT * len(centres)
    parts = []
    for concept, centre in enumerate(centres):
        mine = poses[labels == concept]
        nearest = np.square(mine - centre).sum(axis=(1, 2)).argsort()[:_POSES]
        colour = COLOURS[concept % len(COLOURS)]
        top = concept * _HEIGHT
        parts.append(markup('<text x="4" y="{}" fill="{}">{}: {}</text>', top + 16, colour, concept + 1, len(mine)))
        for place, pose in enumerate([centre, *mine[nearest]]):
            parts.append(
                figure(pose, body.parents, 60 + (place + 0.5) * _CELL, top + _HEIGHT / 2, colour, place == 0)
            )
    return markup(
        '<svg xmlns="http://www.w3.org/2000/svg" width="{}" height="{}" font-size="12">{}</svg>', width, height,
        joined(parts),
    )  # fmt: skip


def _plane(poses: np.ndarray, labels: np.ndarray, seed: int) -> Markup:
    """All anchors in the plane, coloured by concept."""
    from sklearn.manifold import TSNE

    if len(poses) < 10:
        return markup("")
    chosen = np.random.default_rng(seed).permutation(len(poses))[:_MOST_POINTS]
    flat = poses[chosen].reshape(len(chosen), -1)
    places = TSNE(2, perplexity=min(30, (len(flat) - 1) / 3), random_state=seed, init="pca").fit_transform(flat)
    low, high = places.min(axis=0), places.max(axis=0)
    places = 12 + 376 * (places - low) / np.maximum(high - low, 1e-9)
    dots = [
        markup('<circle cx="{:.1f}" cy="{:.1f}" r="2.5" fill="{}"/>', *place, COLOURS[label % len(COLOURS)])
        for place, label in zip(places, labels[chosen], strict=True)
    ]
    return markup(
        '<p>The same anchors in the plane (t-SNE):</p><svg xmlns="http://www.w3.org/2000/svg" width="400" '
        'height="400">{}</svg>', joined(dots),
    )  # fmt: skip
