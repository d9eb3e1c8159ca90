"""The public functions: each takes paths, names and keywords, loads and names, and calls the engine of its room.

An engine takes values (a `Dataset` with points, `FitOptions`, effects), and so do refits, searches and the page, which
call engines alone. Nothing of the core imports these modules but `calib/__init__.py`, by name.
"""
