"""The hypotheses under way: poses with what speaks for them, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from vision.confirmation import Evidence

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class HypothesisPool:
    """N hypotheses.

    Attributes:
        poses: (N, 4, 4) T_world_part.
        matches: (N, V, K) the ellipses matched to the salient circles, -1 for none.
        seed: (N, 3) view, ellipse and salient circle that the hypothesis was made from; -1 for an arc.
        salient: (N,) edge support of the salient circles.
        score: (N,) edge support of all circles; that of the salient ones before the hypothesis is turned.
        turned: (N,) whether the rotation about the axis has been looked for.
        inplane_known: (N,) whether it was found.
    """

    poses: Array
    matches: Indices
    seed: Indices
    salient: Array
    score: Array
    turned: Mask
    inplane_known: Mask

    @classmethod
    def of(cls, poses: Array, matches: Indices, seed: Indices, salient: Array) -> HypothesisPool:
        """New hypotheses, not yet turned about their axes."""
        no = np.zeros(len(poses), bool)
        return cls(poses, matches, seed, salient, salient, no, no)

    @classmethod
    def empty(cls, views: int, circles: int) -> HypothesisPool:
        """No hypotheses about a model with so many salient circles in so many views."""
        none = np.empty(0)
        matches = np.empty((0, views, circles), np.intp)
        return cls.of(np.empty((0, 4, 4)), matches, np.empty((0, 3), np.intp), none)

    def __len__(self) -> int:
        """Number of hypotheses."""
        return len(self.poses)

    def take(self, index: Indices | Mask) -> HypothesisPool:
        """Some of the hypotheses."""
        return HypothesisPool(*(getattr(self, field.name)[index] for field in fields(self)))

    def joined(self, other: HypothesisPool) -> HypothesisPool:
        """These and others."""
        mine = (getattr(self, field.name) for field in fields(self))
        theirs = (getattr(other, field.name) for field in fields(self))
        return HypothesisPool(*(np.concatenate(pair) for pair in zip(mine, theirs, strict=True)))

    @property
    def standing(self) -> Array:
        """(N,) before the rotation about the axis is known, only the salient circles count."""
        return np.where(self.turned, self.score, self.salient)

    def near(self, origin: Array, distance_m: float) -> Mask:
        """(N,) whose origin is nearer than that to a point (3,)."""
        return np.asarray(np.linalg.norm(self.poses[:, :3, 3] - origin, axis=1) < distance_m)

    def weighed(self, index: Indices, evidence: Evidence) -> HypothesisPool:
        """The pool with new evidence for the hypotheses of these numbers."""
        salient, score = self.salient.copy(), self.score.copy()
        salient[index], score[index] = evidence.salient, evidence.score
        return replace(self, salient=salient, score=score)
