"""What poses may be planned for beside a calibration and an effect's size."""
