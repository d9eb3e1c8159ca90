"""Parts of `benchmarks/soak.py`: cases by number, processes kept alive for them, a record to go on from."""
