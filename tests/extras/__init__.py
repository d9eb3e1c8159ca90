"""Tests of the extras, a folder each: those of an extra that is not there are not collected."""
