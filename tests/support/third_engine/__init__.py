"""A third simulator of arms, by screws and quaternions. It shares no code with calib or with `tests.support.engine`."""
