"""Robot programs: the one that measures a plan, of `plan`, and those that `correct` corrects."""
