"""Following of the folder of the dataset on show; looks are made in the background."""

from __future__ import annotations

import threading
import time

from calib.errors import CalibError
from calib.extras.follow.campaign import Campaign
from calib.extras.follow.follower import CampaignFollower
from calib.served_process import BoundedExecutor
from inspector.app.page.tab_controller import Page, TabController
from inspector.extras.follow.live_panel import LivePanel
from inspector.server.background import Background
from inspector.server.worker import LongWork

LOOK_S = 0.3  # between two looks


class LiveController(TabController):
    """Controller that follows the folder of the dataset on show while the page asks for it."""

    def __init__(self, page: Page, panel: LivePanel) -> None:
        self._folders, self._state, self._worker, self._panel = page.folders, page.state, page.worker, panel
        self._background, self._bounded = Background("live"), BoundedExecutor(1)
        self._followers: dict[str, CampaignFollower] = {}  # by dataset: what was searched stays known
        self._stop = threading.Event()
        self._stop.set()
        panel.on_switched = lambda on: page.worker.submit("follow folder", lambda: self._switch(on))

    def close(self) -> None:
        """End the looks and the thread."""
        self._stop.set()
        self._background.close()
        self._bounded.shutdown(wait=False, cancel_futures=True)

    @property
    def campaign(self) -> Campaign | None:
        """Campaign of the dataset on show; None where its folder was never followed."""
        follower = self._followers.get(self._state.name)
        return None if follower is None else follower.campaign

    def _switch(self, on: bool) -> None:
        """Begin to follow the folder of the dataset on show, or end that."""
        self._stop.set()
        if on:
            self._stop = threading.Event()
            threading.Thread(target=self._run, args=(self._stop,), name="inspector-live", daemon=True).start()

    def opened(self) -> None:
        """Show the campaign of the dataset that was just opened."""
        campaign = self.campaign
        if campaign is None:
            self._panel.clear(self._state.name)
        else:
            self._panel.update(campaign)

    def _run(self, stop: threading.Event) -> None:
        while not stop.is_set():
            if not self._worker.running("live"):
                self._worker.submit("live", self._show)
            stop.wait(LOOK_S)

    def _show(self) -> LongWork:
        """Long work that looks at the folder once and shows what it brought."""
        name = self._state.name
        if self._stop.is_set() or name not in self._folders:
            return
        follower = self._followers.setdefault(name, CampaignFollower(self._folders[name], self._bounded))
        before = follower.campaign
        try:
            news = yield from self._background.run(lambda: follower.look(time.monotonic()))
        except CalibError as error:
            self._panel.say(str(error), bad=True)
            return
        if news is None or self._state.name != name:
            return
        if news.fault:
            self._panel.say(news.fault, bad=True)
        elif follower.campaign is not None and follower.campaign is not before:
            self._panel.update(follower.campaign)
