"""Many datasets: the commands `fleet` and `pool`."""
