"""What the errors of a scan's points do to the planes, where neighbours share them."""
