"""Arms, scenes, simulators, small datasets, a browser and a page's client, shared by tests and benchmarks."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]  # of the project
SHARED_DATA = ROOT.parent / "shared" / "data"  # real measurements, where they lie beside the project
