"""Learned curves: an unknown smooth error of each joint, its spectrum and size chosen by evidence."""
