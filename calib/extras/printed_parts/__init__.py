"""Parts to print for measuring without an instrument: sockets, corners, stems."""
