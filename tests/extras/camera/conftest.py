"""The app and a page of it, as the page's own tests have them."""

from tests.inspector.conftest import app, browser_page, folder, page, running

__all__ = ["app", "browser_page", "folder", "page", "running"]
