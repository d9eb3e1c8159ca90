"""The command `follow`: a dataset folder while it is being measured, judged pose by pose."""

from __future__ import annotations

import sys
import time

from calib.errors import DatasetError, visible
from calib.extras.follow.campaign import Campaign
from calib.extras.follow.follower import CampaignFollower, News
from calib.extras.follow.present.campaign import campaign_head, judgement_document, judgement_line, moved_sentence
from calib.present import to_dict
from calib.rendering import numbers
from calib.rendering.text import block_text
from calib.strict_json import to_json
from inspector.cli.progress import MIN_SCANS_FOR_PROCESSES, processes
from inspector.extras.follow.options import FollowOptions

_LOOK_S = 0.2  # between two looks


def run_follow(options: FollowOptions) -> int:
    """Follow a folder until Ctrl-C, or until it is at rest (--once); exit code 0 where enough was measured.

    Events of the file system would tell of a change earlier than looks from time to time, but a file has to rest before
    it is read, and network drives, to which scanners write, send none.
    """
    if not options.path.is_dir():
        raise DatasetError(f"{options.path}: no such folder; give the dataset folder that is being filled")
    scans = sum(1 for path in options.path.glob("*/*") if path.is_file())
    with processes(scans if scans >= MIN_SCANS_FOR_PROCESSES else 0) as executor:
        follower = CampaignFollower(options.path, executor)
        try:
            while True:
                _tell(options, follower.look(time.monotonic()), follower.campaign)
                if options.once and follower.is_at_rest:
                    break
                time.sleep(_LOOK_S)
        except KeyboardInterrupt:
            pass
    campaign = follower.campaign
    if follower.fault:
        raise DatasetError(follower.fault)
    if campaign is None or not campaign.in_state("good", "doubtful", "repeat"):
        unknown = () if campaign is None else campaign.unknown
        why = "points.csv, or the scans, are what is followed"
        if unknown:
            why = f"poses.csv has no pose {numbers.listing(unknown)}"
        raise DatasetError(f"{options.path}: nothing was measured; {why}")
    if not options.json:
        print(visible(block_text(*campaign_head(campaign, options.tolerance_mm))))
    return 0 if campaign.is_enough(options.tolerance_mm) else 1


def _tell(options: FollowOptions, news: News, campaign: Campaign | None) -> None:
    """Print what a look brought: a line for each pose, faults of the tables on stderr."""
    if news.fault and not options.once:
        print(visible(f"inspector: warning: {news.fault}"), file=sys.stderr, flush=True)
    if campaign is None or not news.judged:
        return
    if options.json:
        for judged in news.judged:
            document = judgement_document(campaign, judged, options.tolerance_mm)
            print(to_json(to_dict(document)), file=options.stdout, flush=True)
        return
    lines = [judgement_line(campaign, judged) for judged in news.judged]
    if campaign.off_since:
        lines.append(moved_sentence(campaign.off_since))
    elif campaign.outlook is not None and campaign.outlook.next:
        lines.append(f"    next: {campaign.outlook.next[0]}")
    print(visible("\n".join(lines)), flush=True)
