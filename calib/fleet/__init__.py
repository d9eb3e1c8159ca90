"""Many datasets at once: each judged by itself on any executor, then compared by arm and searched for shared causes."""
