"""A second simulator of arms and scanners, for datasets whose cause is known. It shares no code with `calib`.

From calib it takes values only, to write a dataset (`cases.py`). Lengths mm, angles rad, masses kg, moments N m.
"""
