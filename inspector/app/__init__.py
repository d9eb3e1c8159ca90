"""What a request of the page does: stage, controllers, camera, downloads."""
