"""The panels of the page, one module each: widgets that send requests to the app, and an `update` to show results."""
