"""Many datasets: the commands `fleet` and `pool`, their page and figure."""
