"""Handling of the page's requests: stage, controllers, camera, downloads."""
