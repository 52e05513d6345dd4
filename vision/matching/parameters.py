"""Settings of the matching."""

from __future__ import annotations

from dataclasses import dataclass

from vision.errors import InputError
from vision.pose.calibration import EXACT, CalibrationError
from vision.pose.edge_errors import USUAL, EdgeErrors
from vision.pose.probability import USUAL_WEIGHTS, ProbabilityWeights
from vision.settings import NOT_NEGATIVE, POSITIVE, SHARE, Allowed, check, count


@dataclass(frozen=True)
class ConfirmationParameters:
    """How the edges along a posed model confirm or refute it, and what they count for.

    ``benchmark/tuning/confirmation.py`` shows how much each of them matters.

    Attributes:
        reach_px: how far from the projected model an edge supports it.
        claim_support: support of a sample from which a part that was found claims its edge.
        claimed_share: share of an arc's points on claimed edges, from which the arc counts as claimed.
        chance_support: what random edges give.
        least_shown: share of the circles that face a view; a pose that shows less of them needs extra support,
        demand: so much of it for each share that is lacking.
        inplane_step_px: how finely the turn about the axis is looked for.
        rival_px: how far from the best turn another one is a rival.
        rival_support: by how much less than the best a rival is supported where it is no worse.
        rival_coarse_support: the same before it is looked at closely.
        most_peaks: how many turns are looked at closely.
        outstanding_support: by how much more than the median turn the best one is supported where it stands out,
        outstanding_spreads: and by how many standard deviations of all turns.
    """

    reach_px: float = 3.0
    claim_support: float = 0.3
    claimed_share: float = 0.3
    chance_support: float = 0.2
    least_shown: float = 0.4
    demand: float = 1.6
    inplane_step_px: float = 1.5
    rival_px: float = 6.0
    rival_support: float = 0.005
    rival_coarse_support: float = 0.05
    most_peaks: int = 6
    outstanding_support: float = 0.08
    outstanding_spreads: float = 4.0

    def __post_init__(self) -> None:
        # Support falls from one pixel off the model to nothing at the tolerance.
        check(self, reach_px=Allowed(1, above=True), inplane_step_px=POSITIVE, least_shown=Allowed(0, 1, above=True))
        check(self, claim_support=SHARE, claimed_share=SHARE, chance_support=SHARE, demand=NOT_NEGATIVE)
        check(self, rival_px=NOT_NEGATIVE, rival_support=NOT_NEGATIVE, rival_coarse_support=NOT_NEGATIVE)
        check(self, most_peaks=count(1), outstanding_support=NOT_NEGATIVE, outstanding_spreads=NOT_NEGATIVE)


CONFIRMATION = ConfirmationParameters()
"""The usual settings."""


@dataclass(frozen=True)
class MatchingParameters:
    """Settings of the matching.

    Attributes:
        candidates: how many of the most promising candidates are refined and confirmed in a round.
        minimum_scores: edge support below which a pose is not accepted, round by round: what is beyond doubt first.
        minimum_separation: distance of two parts below which one of them is a duplicate, in part diameters.
        floor_slack: how far below the workspace a part may reach, in part diameters; more than calibrations are off.
        reach_px: how far from the projected model edges are looked for, iteration by iteration.
        rim_reach_px: the same for the first correction of a candidate.
        whole_reach_px: the same where all circles correct a doubtful hypothesis once more.
        doubtful_scores: between them a hypothesis is doubtful.
        loose_reach_px: tolerance with which candidates are first weighed by the edges near them.
        depth_shares: relative changes of the distance that are tried for a candidate.
        far_depth_shares: the same for a pose that only one view supports.
        confirmation: of the edges along a posed model.
        leash: how far a refinement may move a pose before it has run away, in part diameters.
        calibration: how unsure the calibration of the views is; it widens the covariances and moves no pose.
        edge_errors: the errors that many edges share; they too widen the covariances and move no pose.
        least_probability: of a pose that is reported.
        probability_weights: how likely a pose is right by what confirms it.
        joint_edges: refine on every edge along the model; otherwise only on the matched ellipses' own points.
        depth_search: try other distances for a candidate and for a pose that only one view supports.
        hiding: parts that were found hide what lies behind them, which is then not held against a hypothesis.
        patterns: taught patterns, too, say how a part is turned and confirm it.
        arcs: where no ellipse is left of a part, a long arc may suggest a pose.
    """

    candidates: int = 16
    minimum_scores: tuple[float, ...] = (0.6, 0.5, 0.42)
    minimum_separation: float = 0.12
    floor_slack: float = 0.05
    reach_px: tuple[float, ...] = (2.5, 1.5, 1.5)
    rim_reach_px: tuple[float, ...] = (6.0, 4.0, 3.0)
    whole_reach_px: tuple[float, ...] = (4.0, 2.5)
    doubtful_scores: tuple[float, float] = (0.25, 0.6)
    loose_reach_px: float = 7.0
    depth_shares: tuple[float, ...] = (0.0, -0.02, -0.015, -0.01, -0.005, 0.005, 0.01, 0.015, 0.02)
    far_depth_shares: tuple[float, ...] = tuple(0.0025 * step for step in range(-16, 17))
    confirmation: ConfirmationParameters = CONFIRMATION
    leash: float = 0.05
    calibration: CalibrationError = EXACT
    edge_errors: EdgeErrors = USUAL
    least_probability: float = 0.5
    probability_weights: ProbabilityWeights = USUAL_WEIGHTS
    joint_edges: bool = True
    depth_search: bool = True
    hiding: bool = True
    patterns: bool = True
    arcs: bool = True

    def __post_init__(self) -> None:
        check(self, candidates=count(1), minimum_scores=NOT_NEGATIVE, minimum_separation=NOT_NEGATIVE)
        check(self, floor_slack=NOT_NEGATIVE, least_probability=SHARE)
        check(self, reach_px=POSITIVE, rim_reach_px=POSITIVE, whole_reach_px=POSITIVE, doubtful_scores=SHARE)
        # Support falls from one pixel off the model to nothing at the tolerance.
        check(self, loose_reach_px=Allowed(1, above=True), leash=NOT_NEGATIVE)
        closer = Allowed(-1, above=True)  # the part stays before the camera
        check(self, depth_shares=closer, far_depth_shares=closer)
        weights = self.probability_weights
        if not isinstance(weights, ProbabilityWeights) or not weights.are_valid:
            expected = "ProbabilityWeights, each a finite float >= 0"
            raise InputError("probability_weights", got=weights, expected=expected)
        if len(self.doubtful_scores) != 2 or self.doubtful_scores[0] > self.doubtful_scores[1]:
            raise InputError("doubtful_scores", got=self.doubtful_scores, expected="two numbers, low <= high")
