"""The command `follow`: a dataset folder while it is being measured, judged pose by pose."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

from calib.errors import DatasetError, visible
from calib.extras.follow.campaign import Campaign
from calib.extras.follow.follower import CampaignFollower, News
from calib.extras.follow.present.campaign import (
    campaign_head,
    judgement_document,
    judgement_line,
    moved_sentence,
    unknown_document,
    unknown_sentence,
)
from calib.present import to_dict
from calib.rendering.text import block_text
from calib.strict_json import to_json
from inspector.cli.progress import MIN_SCANS_FOR_PROCESSES, processes
from inspector.extras.follow.options import FollowOptions

_LOOK_S = 0.2  # between two looks


def run_follow(options: FollowOptions) -> int:
    """Follow a folder until Ctrl-C, or until it is at rest (--once) or good enough (--until-enough)."""
    if not options.path.is_dir():
        raise DatasetError(f"{options.path}: no such folder; give the dataset folder that is being filled")
    scans = sum(1 for path in options.path.glob("*/*") if path.is_file())
    with processes(scans if scans >= MIN_SCANS_FOR_PROCESSES else 0) as executor:
        follower = CampaignFollower(options.path, options.fit_options(), executor)
        try:
            for _ in _looks():
                news = follower.look(time.monotonic())
                _tell(options, follower.campaign, news)
                if options.once and follower.is_at_rest:
                    break
                if options.until_enough and _is_enough(options, follower.campaign):
                    break
        except KeyboardInterrupt:
            pass
    campaign = follower.campaign
    if follower.fault:
        raise DatasetError(follower.fault)
    if campaign is None or not campaign.judged:
        why = "points.csv, or the scans, are what is followed"
        if campaign is not None and campaign.unknown:
            why = unknown_sentence(campaign.unknown)
        raise DatasetError(f"{options.path}: nothing was measured; {why}")
    if not options.json:
        print(visible(block_text(*campaign_head(campaign, options.tolerance_mm))))
    return 0 if _is_enough(options, campaign) else 1


def _looks() -> Iterator[None]:
    """A step for each look at the folder, at once and then from time to time.

    Events of the file system would tell of a change earlier, but a file has to rest before it is read, and network
    drives, to which scanners write, send none.
    """
    while True:
        yield
        time.sleep(_LOOK_S)


def _is_enough(options: FollowOptions, campaign: Campaign | None) -> bool:
    if campaign is None:
        return False
    if options.tolerance_mm is not None:
        return campaign.is_within(options.tolerance_mm)
    return campaign.has_enough


def _tell(options: FollowOptions, campaign: Campaign | None, news: News) -> None:
    """Print what a look brought: a line for each pose, faults of the tables on stderr."""
    if news.fault and not options.once:
        print(visible(f"inspector: warning: {news.fault}"), file=sys.stderr, flush=True)
    if campaign is None:
        return
    if options.json:
        documents = [unknown_document(campaign, name, options.tolerance_mm) for name in news.unknown]
        documents += [judgement_document(campaign, judged, options.tolerance_mm) for judged in news.judged]
        for document in documents:
            print(to_json(to_dict(document)), file=options.stdout, flush=True)
        return
    lines = [unknown_sentence(news.unknown)] if news.unknown else []
    for line in (*lines, *(judgement_line(campaign, judged) for judged in news.judged)):
        print(visible(line), flush=True)
    if news.judged and campaign.off_since:
        print(visible(moved_sentence(campaign.off_since)), flush=True)
    elif news.judged and campaign.outlook is not None and campaign.outlook.next:
        first = campaign.outlook.next[0].pose
        print(f"    next: {first}" if first else "", end="\n" if first else "", flush=True)
