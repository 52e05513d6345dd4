"""Settings of the paper's system."""

from __future__ import annotations

from dataclasses import dataclass, field

from vision.paper.edge_grouping import AggregationParameters
from vision.paper.region_growing import PruningParameters
from vision.settings import NOT_NEGATIVE, POSITIVE, SHARE, check, count


@dataclass(frozen=True)
class PaperParameters:
    """Settings of the paper's system.

    Attributes:
        region: of region growing.
        group: of edge grouping.
        size_slack: by how much the semi-major axis of an ellipse may leave what the workspace allows.
        slack: factor on the tolerances with which the same circle is looked for in another view.
        most_candidates: so many readings of ellipses are looked for in other views, the best supported ones.
        most_hypotheses: so many of the best supported correspondences are verified.
        fewest_matches: least number of ellipses, over all views, that a correspondence must explain.
        fewest_supporting: least number of supporting features, over all views, that must verify a hypothesis.
        shared: largest share of its ellipses that a hypothesis may have in common with an accepted one.
        own_extractors: this project's extractors, both for every feature, instead of those of the paper as taught.
        edge_fit: the pose by stereo is fitted to the edges along the model in all views.
        separation: parts found nearer to each other than this share of their diameter are one.
    """

    region: PruningParameters = field(default_factory=PruningParameters)
    group: AggregationParameters = field(default_factory=AggregationParameters)
    size_slack: float = 0.15
    slack: float = 4.0
    most_candidates: int = 100
    most_hypotheses: int = 25
    fewest_matches: int = 2
    fewest_supporting: int = 1
    shared: float = 0.3
    own_extractors: bool = False
    edge_fit: bool = False
    separation: float = 0.2

    def __post_init__(self) -> None:
        check(self, size_slack=NOT_NEGATIVE, slack=POSITIVE, separation=POSITIVE, shared=SHARE)
        check(self, most_candidates=count(1), most_hypotheses=count(1), fewest_matches=count(1))
        check(self, fewest_supporting=count())
