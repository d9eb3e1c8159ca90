"""The learned effect: an unknown smooth curve for each joint, its spectrum and size chosen by evidence."""
