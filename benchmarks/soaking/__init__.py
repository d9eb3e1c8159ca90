"""What `benchmarks/soak.py` runs: cases by number, processes kept alive for them, a record to go on from."""
