"""The panels of the page, one module each: widgets that ask the app for something, and an `update` that shows it."""
