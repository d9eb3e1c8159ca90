"""Many datasets at once: each judged by itself on any executor, then what they say together of arms and causes."""
