"""What is told of watched cells and of planned check poses."""
