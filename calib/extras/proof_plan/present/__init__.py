"""What is told of planned proofs."""
