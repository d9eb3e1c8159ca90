"""What other datasets say beside the one on show."""
