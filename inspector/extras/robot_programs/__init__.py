"""Robot programs: the one that measures a plan, of `plan` and the page, and those that `correct` corrects."""
