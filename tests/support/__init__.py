"""What tests and benchmarks share: arms, scenes, simulators, small datasets, a browser and a page's client."""
